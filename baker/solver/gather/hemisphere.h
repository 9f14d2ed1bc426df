#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "baker/sampling/direction_set.h"
#include "baker/simd/kernels.h"
#include "baker/solver/gather/packet_layout.h"
#include "baker/solver/world.h"

namespace kiln::solver::gather {

/// Follows rays over the hemispheres of texels' footprints, to the texels that hold the light of
/// what they meet. Immutable; callable from many threads.
class Hemisphere {
 public:
  Hemisphere(const World&, const PacketLayout&);

  /// A texel that sends rays, and what it gets.
  struct Gathering {
    std::uint32_t texel = 0;
    std::span<std::uint32_t> hits;  ///< per direction: a texel, kHitSky or kHitNothing
    float visible = 1;              ///< see follow_and_probe()
    /// Radiance of a sky map in the directions that met nothing, weighted by SkyShares: sums over
    /// the two halves of the directions. Black where the sky is uniform.
    std::array<math::Rgb, 2> sky{};
  };
  /// This many texels form a run whose directions are followed together.
  static constexpr std::uint32_t kTileTexels = kSampleTileTexels;

  /// Follows the directions of some texels of one tile, dealt over the points of their footprints.
  /// The result of a texel does not depend on the others.
  void follow(std::span<Gathering>, const sampling::DirectionSet&) const;
  /// Does the same, and finds the share of each footprint that is not hidden: all rays from a
  /// hidden point meet the backs of surfaces. Sends more rays when few of them met backs.
  void follow_and_probe(std::span<Gathering>, const sampling::DirectionSet&) const;
  /// Returns the sky's light on a texel: E = π · mean L over the directions.
  sampling::Estimate sky_light(const sampling::DirectionSet&, const Gathering&) const;

 private:
  struct BackfaceTally;
  class Tracer;
  void trace(std::span<Gathering>, const sampling::DirectionSet&, std::span<BackfaceTally>) const;

  const World& world_;
  const PacketLayout& plan_;
  const simd::Kernels& kernels_;
  const sampling::DirectionSet probe_;
};

}  // namespace kiln::solver::gather
