#pragma once

#include <algorithm>
#include <cmath>

#include "baker/math/vec.h"

/// Solids as functions of a point: about the distance to the surface, negative inside. Internal to
/// this folder.
namespace kiln::generate {

inline float ellipsoid(math::Vec3 p, math::Vec3 center, math::Vec3 radii) {
  const math::Vec3 d = p - center;
  const math::Vec3 q{d.x / radii.x, d.y / radii.y, d.z / radii.z};
  const math::Vec3 g{q.x / radii.x, q.y / radii.y, q.z / radii.z};
  const float steepness = length(g);
  const float k = length(q);
  return steepness > 0 ? k * (k - 1) / steepness : -std::min({radii.x, radii.y, radii.z});
}

/// A rod with round ends whose radius goes from `ra` to `rb`.
inline float rod(math::Vec3 p, math::Vec3 a, math::Vec3 b, float ra, float rb) {
  const math::Vec3 ab = b - a;
  const float t = std::clamp(dot(p - a, ab) / dot(ab, ab), 0.f, 1.f);
  return length(p - (a + ab * t)) - (ra + (rb - ra) * t);
}

/// A box with rounded edges by its half size.
inline float rounded_box(math::Vec3 p, math::Vec3 center, math::Vec3 half, float rounding) {
  const math::Vec3 d = p - center;
  const math::Vec3 q{std::abs(d.x) - half.x + rounding, std::abs(d.y) - half.y + rounding,
                     std::abs(d.z) - half.z + rounding};
  const math::Vec3 out{std::max(q.x, 0.f), std::max(q.y, 0.f), std::max(q.z, 0.f)};
  return length(out) + std::min(std::max({q.x, q.y, q.z}), 0.f) - rounding;
}

/// Returns the union of two solids. Where both surfaces are nearer than `blend`, it is rounded.
inline float join(float a, float b, float blend) {
  const float h = std::max(blend - std::abs(a - b), 0.f) / blend;
  return std::min(a, b) - h * h * blend / 4;
}

/// Returns what both solids share, rounded in the same way.
inline float overlap(float a, float b, float blend) {
  return -join(-a, -b, blend);
}

/// Returns `a` without `b`.
inline float carve(float a, float b, float blend) {
  return -join(-a, b, blend);
}

}  // namespace kiln::generate
