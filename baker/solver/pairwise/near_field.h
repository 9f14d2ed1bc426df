#pragma once

#include <algorithm>
#include <cstdint>

#include "baker/solver/world.h"

namespace kiln::solver::pairwise {

/// The view factors of texels that are near to each other, where RTRad's eq. 4.7 fails: it holds
/// for areas that are small against their distance. There the kernel is the mean over all pairs of
/// points of the two footprints [RTRad eq. 4.1 with K = 256]. What stands between the two is not
/// known here. Immutable; callable from many threads.
class NearField {
 public:
  /// Pairs nearer than so many widths of the larger texel are near. Two texels at a right angle,
  /// so far apart, have 2 % too much by the formula.
  static constexpr float kReach = 4;

  /// The points of one texel, structure of arrays.
  struct Points {
    static constexpr std::uint32_t kCount = atlas::TextureGroup::kPointsPerTexel;

    Points() = default;
    Points(const World&, std::uint32_t texel);

    float position[3][kCount], geometric_normal[3][kCount], shading_normal[3][kCount];
  };
  /// The mean of cosθ cosθ'/r² either way, 1/m². The receiver's cosine is that of the shading
  /// normal.
  struct Kernel {
    float forth = 0, back = 0;
  };

  /// @param world outlives this
  explicit NearField(const World& world) : world_(world) {}

  bool is_near(std::uint32_t a, std::uint32_t b) const {
    const math::Vec3 way = world_.texels.position[b] - world_.texels.position[a];
    const float area = std::max(world_.texels.area_m2[a], world_.texels.area_m2[b]);
    return dot(way, way) < kReach * kReach * area;
  }
  Points points(std::uint32_t texel) const { return Points(world_, texel); }
  /// Returns the kernel from b to a (forth) and from a to b. The bits are those of the other order
  /// of a and b, the other way round.
  static Kernel mean(const Points& a, const Points& b);

 private:
  const World& world_;
};

}  // namespace kiln::solver::pairwise
