#pragma once

#include <span>
#include <stop_token>

#include "baker/atlas/unwrap.h"

namespace kiln::atlas {

inline double dot(const Vec3d& a, const Vec3d& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline double length(const Vec3d& a) {
  return std::sqrt(dot(a, a));
}
inline Vec3d add(const Vec3d& a, const Vec3d& b, double scale) {
  return {a.x + b.x * scale, a.y + b.y * scale, a.z + b.z * scale};
}
/// Returns the unit vector along `a`, or +Y when `a` has no direction.
inline Vec3d unit(const Vec3d& a) {
  const double l = length(a);
  return l > 0 ? Vec3d{a.x / l, a.y / l, a.z / l} : Vec3d{0, 1, 0};
}
inline Vec3d cross(const Vec3d& a, const Vec3d& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// Returns a triangle's normal, whose length is twice the triangle's area.
Vec3d normal_of(math::Vec3 a, math::Vec3 b, math::Vec3 c);
/// Returns the area-weighted mean of the faces' normals, as a unit vector.
Vec3d mean_normal(std::span<const std::uint32_t> faces, std::span<const Vec3d> normal,
                  std::span<const double> area);

/// Returns the frame across `axis` in which the points' bounding rectangle has the least area, with
/// width >= height. It tries the edges of the convex hull, at most 64 of them. When stopped it
/// returns any frame.
ChartFrame smallest_frame(std::span<const math::Vec3> points, const Vec3d& axis,
                          const std::stop_token&);

}  // namespace kiln::atlas
