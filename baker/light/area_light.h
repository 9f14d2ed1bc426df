#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "baker/math/vec.h"
#include "baker/scene/scene.h"
#include "baker/simd/kernels.h"

namespace kiln::light {

/// A flat emitter: a triangle or a parallelogram, part of the scene's surface or a RectLight.
struct AreaLight {
  std::array<math::Vec3, 4> corner;  ///< m, counter-clockwise seen from the emitting side
  std::uint32_t corners = 3;         ///< 3, or 4: a parallelogram
  math::Vec3 normal;                 ///< unit
  float area_m2 = 0;
  float longest_edge_m = 0;
  math::Rgb radiance;                   ///< cd/m2, mean over the light
  std::uint32_t textured = 0xffffffff;  ///< the triangle whose texture modulates it, or kUniform
  bool two_sided = false;

  static constexpr std::uint32_t kUniform = 0xffffffff;
  bool is_uniform() const { return textured == kUniform; }
  math::Vec3 first_edge() const { return corner[1] - corner[0]; }
  math::Vec3 second_edge() const { return corner[corners - 1] - corner[0]; }
  math::Vec3 center() const {
    return corners == 4 ? (corner[0] + corner[2]) * 0.5f
                        : (corner[0] + corner[1] + corner[2]) * (1 / 3.f);
  }

  /// Returns the height of `p` over the plane of the light, m. It is 0 within the rounding of the
  /// coordinates, so that a flat lamp far from the origin does not light itself.
  float height_over(math::Vec3 p) const;
  /// Returns whether the emitting side shows to a point at that height.
  bool shows_to(float height) const { return height > 0 || (height < 0 && two_sided); }
  /// Returns how far off the light shadow rays from about `receiver` end, m. This is as far as the
  /// origins of rays are moved off their surfaces, so that the light does not block its own shadow
  /// rays.
  float clearance(math::Vec3 receiver) const;
  /// Returns a lower bound of the distance from `p`, m.
  float least_distance(math::Vec3 p) const;
  std::span<const math::Vec3> outline() const { return {corner.data(), corners}; }

  simd::LightShape shape() const;
};

/// Returns all flat emitters of the scene. Two uniform triangles of one material that form a
/// parallelogram become one light, so that sampling it has no seam. @param surfaces false: only
/// those that are no part of the surface
std::vector<AreaLight> find_area_lights(const scene::Scene&, bool surfaces = true);

}  // namespace kiln::light
