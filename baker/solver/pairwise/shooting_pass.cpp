// Progressive shooting: the brightest texels first.
#include <algorithm>
#include <utility>
#include <vector>

#include "baker/solver/pairwise/passes.h"
#include "baker/solver/pairwise/transport_pass.h"

namespace kiln::solver::pairwise {
namespace {

using lightmap::PlaneId;

class ShootingPass final : public TransportPass {
 public:
  ShootingPass(const Parts& parts, bool is_remembered, PassPlan plan)
      : TransportPass(parts, is_remembered, std::move(plan)) {
    plan_.reads.set(std::size_t(PlaneId::kRadiosity));
    plan_.finishes = lightmap::plane_set({PlaneId::kRadiosity});
    plan_.work = bounce_work(parts) * (1.0 / kShots);
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers&) override {
    read(before);
    const std::uint32_t size = before.size();
    std::vector<float> power(size);  // unshot, lm
    std::vector<std::uint32_t> order;
    for (std::uint32_t t = 0; t < size; ++t) {
      const math::Rgb unshot = radiosity_[t] - before.radiosity[t];
      radiosity_[t] = {std::max(0.f, unshot.r), std::max(0.f, unshot.g), std::max(0.f, unshot.b)};
      power[t] = luminance(radiosity_[t]) * parts_.patches.area_m2(t);
      if (power[t] > 0) order.push_back(t);
    }
    const std::size_t most = std::min<std::size_t>(order.size(), (size + kShots - 1) / kShots);
    std::partial_sort(order.begin(), order.begin() + std::ptrdiff_t(most), order.end(),
                      [&](std::uint32_t a, std::uint32_t b) {
                        return power[a] > power[b] || (power[a] == power[b] && a < b);
                      });
    order.resize(most);
    std::sort(order.begin(), order.end());
    for (const std::uint32_t t : order)
      shots_.list.push_back({t, Sender::kTexelsOwn, parts_.patches.area_m2(t), radiosity_[t]});
    shots_.gather(parts_.patches);
    return true;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      Sum sum;
      double lost = clamps() ? double(before.clamped[i]) : 0;
      rays += add(i, shots_, sum, lost);
      after.indirect[i] = before.indirect[i] + sum.rgb();
      if (clamps()) after.clamped[i] = float(lost);
    }
    return rays;
  }

  bool finish(lightmap::Lightmap& after, const exec::Workers&) override {
    for (const Sender& s : shots_.list) after.radiosity[s.texel] += s.radiosity;
    return true;
  }

 private:
  Senders shots_;
};

}  // namespace

std::unique_ptr<Pass> make_shooting_pass(const Parts& parts, bool is_remembered, PassPlan plan) {
  return std::make_unique<ShootingPass>(parts, is_remembered, std::move(plan));
}

}  // namespace kiln::solver::pairwise
