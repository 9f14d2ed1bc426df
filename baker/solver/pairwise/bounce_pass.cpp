// Bounces: what all senders give to texels, anew in every pass.
#include <algorithm>
#include <utility>

#include "baker/solver/pairwise/passes.h"
#include "baker/solver/pairwise/transport_pass.h"

namespace kiln::solver::pairwise {
namespace {

class BouncePass final : public TransportPass {
 public:
  BouncePass(const Parts& parts, std::uint32_t bounce, atlas::TexelRange tile, bool is_remembered,
             PassPlan plan)
      : TransportPass(parts, is_remembered, std::move(plan)), bounce_(bounce), tile_(tile) {
    plan_.work = bounce_work(parts) * (double(tile.size()) / std::max(1u, parts.patches.size()));
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    read(before);
    if (parts_.senders.are_per_receiver()) return true;
    auto senders = parts_.senders.pick(radiosity_, bounce_, workers.stop);
    if (!senders) return false;
    senders_ = std::move(*senders);
    return true;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    Senders own;
    const std::uint32_t end = std::min(range.end, tile_.end);
    for (std::uint32_t i = std::max(range.begin, tile_.begin); i < end; ++i) {
      Sum sum;
      double lost = 0;
      if (parts_.senders.are_per_receiver()) {
        std::uint32_t window = 0;
        do {
          window = parts_.senders.pick_for(i, radiosity_, bounce_, window, own);
          rays += add(i, own, sum, lost);
        } while (window > 0);
      } else {
        rays += add(i, senders_, sum, lost);
      }
      after.indirect[i] = sum.rgb();
      if (clamps()) after.clamped[i] = float(lost);
    }
    return rays;
  }

  double work_share(double share) const override {
    const double texels = parts_.patches.size();
    return std::clamp((share * texels - tile_.begin) / std::max(1u, tile_.size()), 0.0, 1.0);
  }

 private:
  const std::uint32_t bounce_;
  const atlas::TexelRange tile_;
  Senders senders_;  ///< of all receivers, unless each has its own
};

}  // namespace

std::unique_ptr<Pass> make_bounce_pass(const Parts& parts, std::uint32_t bounce,
                                       atlas::TexelRange tile, bool is_remembered, PassPlan plan) {
  return std::make_unique<BouncePass>(parts, bounce, tile, is_remembered, std::move(plan));
}

}  // namespace kiln::solver::pairwise
