#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "baker/solver/adaptive/rounds.h"
#include "baker/solver/emittance.h"
#include "baker/solver/gather/hemisphere.h"
#include "baker/solver/gather/interpolation_grid.h"
#include "baker/solver/gather/packet_layout.h"
#include "baker/solver/gather/schedule.h"
#include "baker/solver/pass.h"
#include "baker/solver/world.h"

namespace kiln::solver::gather {

/// The parts that all passes of one gather share. Immutable; outlives the passes.
struct GatherParts {
  GatherParts(const World&, std::uint32_t feedback_directions);

  /// Returns directions of the sequence, in the order in which they are traced.
  sampling::DirectionSet directions(std::uint32_t first, std::uint32_t count) const;

  const World& world;
  const InterpolationGrid grid;
  const PacketLayout packets;
  const Hemisphere hemisphere;
  const sampling::DirectionSet set;        ///< the rays whose hits are kept
  const std::vector<math::Rgb> emittance;  ///< M of the texels, lx; empty when rays find it
  const adaptive::AdaptiveSampling sampling;
  const GatherSchedule schedule;
};

// These make the passes of a gather beside the direct one, in their order. Each sets in the plan
// what it reads, writes and finishes.
std::unique_ptr<Pass> make_trace_pass(const GatherParts&, PassPlan);
std::unique_ptr<Pass> make_refine_pass(const GatherParts&, PassPlan);
std::unique_ptr<Pass> make_bounce_pass(const GatherParts&, PassPlan, const BouncePlan::Bounce&);
std::unique_ptr<Pass> make_round_pass(const GatherParts&, PassPlan);

/// Sums what `use` gives for the tiles of a range.
template <class Use>
std::uint64_t sum_over_tiles(atlas::TexelRange range, const Use& use) {
  std::uint64_t sum = 0;
  for (std::uint32_t t = range.begin; t < range.end; t += Hemisphere::kTileTexels)
    sum += use(atlas::TexelRange{t, std::min(t + Hemisphere::kTileTexels, range.end)});
  return sum;
}

/// Follows the directions of the texels of a tile that `wanted` picks: keeps their hits, and writes
/// the sky's light, what share of the texel is hidden, and that it gathers. @return rays traced
template <class Wanted>
std::uint64_t trace_some(const GatherParts& parts, atlas::TexelRange tile,
                         const lightmap::LightmapView& after, const Wanted& wanted) {
  std::array<Hemisphere::Gathering, Hemisphere::kTileTexels> all;
  std::uint32_t count = 0;
  for (std::uint32_t t = tile.begin; t < tile.end; ++t)
    if (wanted(t)) all[count++] = {t, after.hits.of(t)};
  const std::span texels(all.data(), count);
  parts.hemisphere.follow_and_probe(texels, parts.set);
  for (const Hemisphere::Gathering& g : texels) {
    const sampling::Estimate sky = parts.hemisphere.sky_light(parts.set, g);
    after.validity[g.texel] = g.visible;
    after.sky[g.texel] = sky.mean, after.sky_difference[g.texel] = sky.half_difference;
    after.samples[g.texel] = parts.set.size();
    after.gathers[g.texel] = 1;
  }
  return std::uint64_t(count) * parts.set.size();
}

/// Returns the planes that trace_some() writes.
inline lightmap::PlaneSet traced_planes() {
  using enum lightmap::PlaneId;
  return lightmap::plane_set({kValidity, kSky, kSkyDifference, kSamples, kGathers, kHits});
}

}  // namespace kiln::solver::gather
