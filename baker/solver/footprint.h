#pragma once

#include <array>

#include "baker/simd/kernels.h"
#include "baker/solver/world.h"

namespace kiln::solver {

/// The sample points of one texel, ready for tracing. Twins on the back have their normals turned.
struct Footprint {
  static constexpr std::uint32_t kPoints = atlas::TextureGroup::kPointsPerTexel;
  std::array<math::Vec3, kPoints> position;                          ///< on the surface, m
  std::array<math::Vec3, kPoints> origin;                            ///< moved off the surface, m
  std::array<math::Vec3, kPoints> geometric_normal, shading_normal;  ///< unit

  Footprint(const World&, std::uint32_t texel);

  simd::PointFrames frames() const;

  /// Returns which of sixteen consecutive samples of a sequence goes with a point: a permutation,
  /// linear in the bits. The points are a Sobol net themselves (see SamplePoint). With its own
  /// number each would go to the part of a lamp where it is itself on the texel, and the edges of
  /// shadows that run across both would be met all at once.
  static constexpr std::uint32_t sample_of(std::uint32_t point) {
    constexpr std::uint32_t kOfBit[4] = {4, 8, 3, 1};
    std::uint32_t sample = 0;
    for (std::uint32_t bit = 0; bit < 4; ++bit) sample ^= (point >> bit & 1) * kOfBit[bit];
    return sample;
  }
};

/// Names a stream of samples.
enum class SampleStream : std::uint32_t {
  kDirect = 1,
  kGather = 2,
  kPath = 3,
  kGatherTile = 4,
  kSky = 5,
  kIterations = 6,
  kDirectional = 7,
  kLinks = 8
};
/// Returns the key of all random numbers of one texel (or tile, for kGatherTile), for one stream of
/// samples. With `solver.same_directions` all texels have the same.
std::uint32_t texel_seed(const World&, std::uint32_t texel, SampleStream);
/// A seed is hashed with this for the directions that are drawn from the bright parts of the sky.
inline constexpr std::uint32_t kSkyDraws = 0x736b79;

}  // namespace kiln::solver
