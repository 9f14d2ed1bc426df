#pragma once

#include <array>

#include "baker/solver/simd/kernels.h"
#include "baker/solver/solver.h"

namespace kiln::baker {

/// The sample points of one texel, ready for tracing. Twins on the back have their normals turned.
struct Footprint {
  static constexpr std::uint32_t kPoints = TextureGroup::kPointsPerTexel;
  std::array<Vec3, kPoints> position;                          ///< on the surface, m
  std::array<Vec3, kPoints> origin;                            ///< moved off the surface, m
  std::array<Vec3, kPoints> geometric_normal, shading_normal;  ///< unit

  Footprint(const SolverInput&, std::uint32_t texel);

  PointFrames frames() const;
};

/// Key of all random numbers of one texel (or tile, for kGatherTile), for one purpose.
enum class Purpose : std::uint32_t { kDirect = 1, kGather = 2, kPath = 3, kGatherTile = 4 };
std::uint32_t texel_seed(const SolverInput&, std::uint32_t texel, Purpose);
/// Hashed with such a seed: for the directions that are drawn from the bright parts of the sky.
inline constexpr std::uint32_t kSkyDraws = 0x736b79;

}  // namespace kiln::baker
