// Pass 2 of a gather: trace. The directions of every texel are followed once, and what each one met
// is kept: a texel (4 bytes), the sky, or nothing. The sky's light is summed on the way. Where
// light is gathered coarsely only the sites of the grid are traced, and the texels between them get
// means.
#include <utility>

#include "baker/solver/gather/outgoing_radiosity.h"
#include "baker/solver/gather/passes.h"

namespace kiln::solver::gather {
namespace {

using enum lightmap::PlaneId;

class TracePass final : public Pass {
 public:
  TracePass(const GatherParts& parts, PassPlan plan)
      : Pass(std::move(plan)), parts_(parts), radiosity_(parts.world, parts.emittance) {
    plan_.reads = lightmap::plane_set({kDirect, kSky, kIndirect, kValidity, kRadiosity});
    plan_.writes = traced_planes();
    if (compares_sites()) plan_.writes |= lightmap::plane_set({kIndirect, kIndirectDifference});
    if (parts.schedule.is_coarse())
      plan_.finishes =
          lightmap::plane_set({kSky, kSkyDifference, kSamples, kIndirect, kIndirectDifference});
    plan_.work = parts.schedule.trace_work();
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    return !parts_.schedule.is_coarse() || radiosity_.read(before, workers);
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    return sum_over_tiles(range, [&](atlas::TexelRange tile) {
      const std::uint64_t rays = trace_some(parts_, tile, after, [&](std::uint32_t t) {
        const bool traced = !parts_.schedule.is_coarse() || parts_.grid.around(t).count == 0;
        after.gathers[t] = traced;
        return traced;
      });
      if (compares_sites()) add_first_bounce(tile, after);
      return rays;
    });
  }

  bool finish(lightmap::Lightmap& after, const exec::Workers& workers) override {
    return !parts_.schedule.is_coarse() ||
           parts_.grid.interpolate(after, /*sky_too=*/true, parts_.set.size(), workers);
  }

 private:
  bool compares_sites() const {
    return parts_.schedule.is_coarse() && bounce_limit(parts_.world.settings) > 0;
  }
  /// The first bounce of direct light, for the next pass to compare the sites by.
  void add_first_bounce(atlas::TexelRange tile, const lightmap::LightmapView& after) const {
    for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
      if (!after.gathers[t]) continue;
      const sampling::Estimate e = radiosity_.look_up(parts_.set, after.hits.of(t));
      after.indirect[t] = e.mean, after.indirect_difference[t] = e.half_difference;
    }
  }

  const GatherParts& parts_;
  OutgoingRadiosity radiosity_;
};

}  // namespace

std::unique_ptr<Pass> make_trace_pass(const GatherParts& parts, PassPlan plan) {
  return std::make_unique<TracePass>(parts, std::move(plan));
}

}  // namespace kiln::solver::gather
