#include "baker/trace/visibility.h"

#include <algorithm>
#include <cmath>

namespace kiln::trace {

std::uint32_t RayVisibility::blocked(const SegmentPacket& segments) const {
  RayPacket rays;
  for (std::uint32_t i = 0; i < segments.count; ++i) {
    const math::Vec3 from{segments.from_x[i], segments.from_y[i], segments.from_z[i]};
    const math::Vec3 to{segments.to_x[i], segments.to_y[i], segments.to_z[i]};
    const math::Vec3 way = to - from;
    const float epsilon = std::max(scene_.offset(from), scene_.offset(to));
    const float length = std::sqrt(dot(way, way));
    if (!(length > 2 * epsilon)) continue;
    const float share = epsilon / length;
    rays.set(i, from + way * share, way, 1 - 2 * share);
    rays.active |= 1u << i;
  }
  return rays.active ? scene_.occluded(rays, /*coherent=*/true) : 0;
}

}  // namespace kiln::trace
