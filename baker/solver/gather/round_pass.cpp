// The last passes: rounds. Tiles whose error is above the target take more shadow rays, directions
// or both, as the judgement of the light before has chosen (Lightmap::doublings). New directions
// are traced afresh and read what the last bounce read; their estimate is joined with the one
// before.
#include <map>
#include <utility>
#include <vector>

#include "baker/solver/direct/direct.h"
#include "baker/solver/gather/outgoing_radiosity.h"
#include "baker/solver/gather/passes.h"

namespace kiln::solver::gather {
namespace {

using enum lightmap::PlaneId;

class RoundPass final : public Pass {
 public:
  RoundPass(const GatherParts& parts, PassPlan plan)
      : Pass(std::move(plan)),
        parts_(parts),
        direct_(parts.world),
        radiosity_(parts.world, parts.emittance) {
    plan_.reads = shadow_ray_planes() | direction_planes() |
                  lightmap::plane_set({kDoublings, kRadiosity, kGathers});
    plan_.writes = shadow_ray_planes() | direction_planes();
  }

  /// Finds which sets of directions the tiles need, and so which planes change and how much work
  /// that is.
  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    bool adds_shadow_rays = false;
    work_before_.assign(1, 0);
    plan_.work = {};
    adaptive::for_tiles(before.size(), [&](atlas::TexelRange tile) {
      const lightmap::Doublings times = before.doublings[tile.begin];
      adds_shadow_rays = adds_shadow_rays || times.shadow_rays > 0;
      std::uint32_t had = before.samples[tile.begin];
      for (std::uint32_t i = 0; i < times.directions; ++i) {
        const std::uint32_t more = parts_.sampling.more_directions(had);
        if (more == 0) break;
        if (!more_.contains(had)) more_.emplace(had, parts_.directions(had, more));
        had += more;
      }
      const double share = double(tile.size()) / before.size();
      plan_.work +=
          parts_.sampling.cost({times.shadow_rays, times.directions},
                               before.direct_samples[tile.begin], before.samples[tile.begin]) *
          share;
      work_before_.push_back(plan_.work.sum());
    });
    plan_.writes = {};
    if (adds_shadow_rays) plan_.writes |= shadow_ray_planes();
    if (adds_directions()) {
      plan_.writes |= direction_planes();
      radiosity_.restore(before.radiosity);
      if (parts_.schedule.is_coarse()) plan_.finishes = direction_planes();
    }
    return !workers.stop.stop_requested();
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    return sum_over_tiles(range, [&](atlas::TexelRange tile) {
      const lightmap::Doublings times = before.doublings[tile.begin];
      std::uint64_t traced = 0;
      std::uint32_t had = before.direct_samples[tile.begin];
      for (std::uint32_t i = 0; i < times.shadow_rays; ++i) {
        const std::uint32_t more = parts_.sampling.more_shadow_rays(had);
        if (more == 0) break;
        traced += add_shadow_rays(tile, had, more, after);
        had += more;
      }
      had = before.samples[tile.begin];
      for (std::uint32_t i = 0; i < times.directions; ++i) {
        const auto set = more_.find(had);
        if (set == more_.end()) break;
        traced += add_directions(tile, set->second, before, after);
        had += set->second.size();
      }
      return traced;
    });
  }

  bool finish(lightmap::Lightmap& after, const exec::Workers& workers) override {
    return !parts_.schedule.is_coarse() || !adds_directions() ||
           parts_.grid.interpolate(after, /*sky_too=*/true, parts_.set.size(), workers);
  }

  double work_share(double share) const override {
    if (work_before_.empty() || !(work_before_.back() > 0)) return share;
    const double at = share * double(work_before_.size() - 1);
    const auto tile = std::min(std::size_t(at), work_before_.size() - 1);
    const double next = work_before_[std::min(tile + 1, work_before_.size() - 1)];
    const double here = work_before_[tile];
    return (here + (at - double(tile)) * (next - here)) / work_before_.back();
  }

 private:
  static lightmap::PlaneSet shadow_ray_planes() {
    return lightmap::plane_set({kDirect, kDirectDifference, kDirectSamples});
  }
  static lightmap::PlaneSet direction_planes() {
    return lightmap::plane_set({kSky, kSkyDifference, kIndirect, kIndirectDifference, kSamples});
  }
  bool adds_directions() const { return !more_.empty(); }

  std::uint64_t add_shadow_rays(atlas::TexelRange tile, std::uint32_t had, std::uint32_t more,
                                const lightmap::LightmapView& after) const {
    return direct_.run(tile, had, more, [&](std::uint32_t t, const sampling::Estimate& e) {
      after.direct[t] = sampling::joined(after.direct[t], had, e.mean, more);
      after.direct_difference[t] =
          sampling::joined(after.direct_difference[t], had, e.half_difference, more);
      after.direct_samples[t] = had + more;
    });
  }

  std::uint64_t add_directions(atlas::TexelRange tile, const sampling::DirectionSet& set,
                               const lightmap::Lightmap& before,
                               const lightmap::LightmapView& after) const {
    const std::uint32_t had = set.first, more = set.size();
    std::array<Hemisphere::Gathering, Hemisphere::kTileTexels> all;
    std::uint32_t count = 0;
    std::vector<std::uint32_t> hits(std::size_t(tile.size()) * more);
    for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
      after.samples[t] = had + more;
      const bool gathers = before.gathers[t] != 0;
      if (gathers) all[count] = {t, std::span(hits).subspan(std::size_t(count) * more, more)};
      count += gathers;
    }
    const std::span texels(all.data(), count);
    parts_.hemisphere.follow(texels, set);
    const auto join = [&](const sampling::Estimate& e, math::Rgb& mean, float& difference) {
      mean = sampling::joined(mean, had, e.mean, more);
      difference = sampling::joined(difference, had, e.half_difference, more);
    };
    for (const Hemisphere::Gathering& g : texels) {
      const std::uint32_t t = g.texel;
      join(parts_.hemisphere.sky_light(set, g), after.sky[t], after.sky_difference[t]);
      if (bounce_limit(parts_.world.settings) > 0)
        join(radiosity_.look_up(set, g.hits), after.indirect[t], after.indirect_difference[t]);
    }
    return std::uint64_t(count) * more;
  }

  const GatherParts& parts_;
  const direct::DirectLight direct_;
  OutgoingRadiosity radiosity_;
  /// The key is the number of samples before them.
  std::map<std::uint32_t, sampling::DirectionSet> more_;
  std::vector<double> work_before_;  ///< work of all tiles before each, and of all
};

}  // namespace

std::unique_ptr<Pass> make_round_pass(const GatherParts& parts, PassPlan plan) {
  return std::make_unique<RoundPass>(parts, std::move(plan));
}

}  // namespace kiln::solver::gather
