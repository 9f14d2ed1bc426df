// Passes 4 and on: bounces, which trace nothing. Light is linear, so each bounce reads at the kept
// hits only what the one before has changed, ΔB, and adds its mean to the light [RTRad 5.4]. The
// last one, `tail`, scales it by the geometric series that would follow.
#include <utility>

#include "baker/solver/gather/outgoing_radiosity.h"
#include "baker/solver/gather/passes.h"

namespace kiln::solver::gather {
namespace {

using enum lightmap::PlaneId;

class BouncePass final : public Pass {
 public:
  BouncePass(const GatherParts& parts, PassPlan plan, const BouncePlan::Bounce& bounce)
      : Pass(std::move(plan)),
        parts_(parts),
        set_(parts.set.leading(bounce.directions)),
        is_tail_(bounce.stands_for_others),
        radiosity_(parts.world, parts.emittance) {
    plan_.batch_texels = 1024;
    plan_.tail_scale = bounce.tail_scale;
    plan_.reads = lightmap::plane_set(
        {kDirect, kSky, kIndirect, kIndirectDifference, kValidity, kRadiosity, kGathers, kHits});
    plan_.writes = lightmap::plane_set({kIndirect, kIndirectDifference, kRadiosity});
    if (parts.schedule.is_coarse())
      plan_.finishes = lightmap::plane_set({kIndirect, kIndirectDifference});
    plan_.work = parts.schedule.look_up_work(bounce.directions);
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    radiosity_.find_hidden(before);
    if (!radiosity_.read(before, workers)) return false;
    if (is_tail_) radiosity_.scale(1 + float(plan().tail_scale));
    return true;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      if (before.gathers[t]) {
        const sampling::Estimate update =
            radiosity_.look_up(set_, before.hits.of(t).first(set_.size()));
        after.indirect[t] = before.indirect[t] + update.mean;
        after.indirect_difference[t] = before.indirect_difference[t] + update.half_difference;
      }
      after.radiosity[t] = before.radiosity[t] + radiosity_.radiosity(t);
    }
    return 0;
  }

  bool finish(lightmap::Lightmap& after, const exec::Workers& workers) override {
    return !parts_.schedule.is_coarse() ||
           parts_.grid.interpolate(after, /*sky_too=*/false, parts_.set.size(), workers);
  }

 private:
  const GatherParts& parts_;
  const sampling::DirectionSet set_;
  const bool is_tail_;
  OutgoingRadiosity radiosity_;
};

}  // namespace

std::unique_ptr<Pass> make_bounce_pass(const GatherParts& parts, PassPlan plan,
                                       const BouncePlan::Bounce& bounce) {
  return std::make_unique<BouncePass>(parts, std::move(plan), bounce);
}

}  // namespace kiln::solver::gather
