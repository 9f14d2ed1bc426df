// Pass 3 of a coarse gather: refine. A texel between the sites is traced as they were, where their
// light differs by too much for a mean. What the sites were compared by, the first bounce of direct
// light, is no part of the light yet and is taken back.
#include <utility>

#include "baker/solver/gather/passes.h"

namespace kiln::solver::gather {
namespace {

using enum lightmap::PlaneId;

class RefinePass final : public Pass {
 public:
  RefinePass(const GatherParts& parts, PassPlan plan) : Pass(std::move(plan)), parts_(parts) {
    plan_.reads = lightmap::plane_set({kDirect, kSky, kIndirect, kValidity});
    plan_.writes = traced_planes();
    plan_.finishes =
        lightmap::plane_set({kSky, kSkyDifference, kSamples, kIndirect, kIndirectDifference});
    plan_.work = parts.schedule.refine_work();
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    return sum_over_tiles(range, [&](atlas::TexelRange tile) {
      return trace_some(parts_, tile, after, [&](std::uint32_t t) {
        const InterpolationGrid::Sites sites = parts_.grid.around(t);
        return sites.count > 0 && !parts_.grid.agree(sites, before);
      });
    });
  }

  bool finish(lightmap::Lightmap& after, const exec::Workers& workers) override {
    if (bounce_limit(parts_.world.settings) > 0)
      after.indirect.clear(), after.indirect_difference.clear();
    return parts_.grid.interpolate(after, /*sky_too=*/true, parts_.set.size(), workers);
  }

 private:
  const GatherParts& parts_;
};

}  // namespace

std::unique_ptr<Pass> make_refine_pass(const GatherParts& parts, PassPlan plan) {
  return std::make_unique<RefinePass>(parts, std::move(plan));
}

}  // namespace kiln::solver::gather
