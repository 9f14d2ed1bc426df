#pragma once

#include <span>
#include <stop_token>

#include "baker/atlas/unwrap.h"

namespace kiln::atlas {

/// Returns the unit vector along `a`, or +Y when `a` has no direction.
inline math::Vec3d unit(const math::Vec3d& a) {
  const double l = length(a);
  return l > 0 ? math::Vec3d{a.x / l, a.y / l, a.z / l} : math::Vec3d{0, 1, 0};
}
/// Returns a triangle's normal, whose length is twice the triangle's area.
math::Vec3d normal_of(math::Vec3 a, math::Vec3 b, math::Vec3 c);
/// Returns the area-weighted mean of the faces' normals, as a unit vector.
math::Vec3d mean_normal(std::span<const std::uint32_t> faces, std::span<const math::Vec3d> normal,
                        std::span<const double> area);

/// Returns the frame across `axis` in which the points' bounding rectangle has the least area, with
/// width >= height. It tries the edges of the convex hull, at most 64 of them. When stopped it
/// returns any frame.
ChartFrame smallest_frame(std::span<const math::Vec3> points, const math::Vec3d& axis,
                          const std::stop_token&);

}  // namespace kiln::atlas
