#include "baker/trace/visibility.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "baker/sampling/sobol.h"

namespace kiln::trace {
namespace {

/// Returns a number in [0,1) that hangs on the ends of a segment alone.
float share_of(math::Vec3 from, math::Vec3 to) {
  std::uint32_t key = 0;
  for (const float c : {from.x, from.y, from.z, to.x, to.y, to.z})
    key = sampling::hash(key, std::bit_cast<std::uint32_t>(c));
  return float(key >> 8) * 0x1p-24f;
}

}  // namespace

std::uint32_t VoxelVisibility::blocked(const SegmentPacket& segments) const {
  std::uint32_t blocked = 0, lane[16];
  SegmentPacket traced;
  for (std::uint32_t i = 0; i < segments.count; ++i) {
    const math::Vec3 from = segments.start(i), to = segments.end(i);
    if (ratio_ < 1 && share_of(from, to) >= ratio_) {
      lane[traced.count] = i;
      traced.add(from, to);
    } else if (is_blocked(from, to)) {
      blocked |= 1u << i;
    }
  }
  if (traced.count == 0) return blocked;
  const std::uint32_t by_rays = rays_.blocked(traced);
  for (std::uint32_t i = 0; i < traced.count; ++i) blocked |= (by_rays >> i & 1) << lane[i];
  return blocked;
}

bool VoxelVisibility::is_blocked(math::Vec3 from, math::Vec3 to) const {
  const math::Vec3 way = to - from;
  const float length = std::sqrt(dot(way, way));
  const bool is_exact = march_ == March::kExact;
  const float off = is_exact ? kExactEnds * grid_.voxel_m() : kFixedEnds * grid_.longest_m();
  if (!(length > 2 * off)) return false;
  const math::Vec3 in = way * (off / length);
  return is_exact ? grid_.meets(from + in, to - in)
                  : grid_.meets_at_steps(from + in, to - in, kSteps);
}

}  // namespace kiln::trace
