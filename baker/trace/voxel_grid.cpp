#include "baker/trace/voxel_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace kiln::trace {
namespace {

using math::Vec3;

/// Triangles between two looks at the stop token.
constexpr std::uint32_t kRunTriangles = 4096;

float axis(Vec3 v, int a) {
  return a == 0 ? v.x : a == 1 ? v.y : v.z;
}

int main_axis(Vec3 n) {
  const float x = std::abs(n.x), y = std::abs(n.y), z = std::abs(n.z);
  return x >= y && x >= z ? 0 : y >= z ? 1 : 2;
}

/// A triangle seen along the main axis of its normal: a plane of heights over two coordinates.
struct Projected {
  int along, u, v;
  float at[3][2], height[3];
  float slope[2], base;   ///< height = base + slope · (u, v)
  float edge[3][3];       ///< edge · (u, v, 1) >= 0 inside
  float low[2], high[2];  ///< bounds
  float lowest, highest;

  explicit Projected(const Vec3 (&corner)[3], Vec3 normal) {
    along = main_axis(normal), u = (along + 1) % 3, v = (along + 2) % 3;
    for (int i = 0; i < 3; ++i) {
      at[i][0] = axis(corner[i], u), at[i][1] = axis(corner[i], v);
      height[i] = axis(corner[i], along);
    }
    const float n = axis(normal, along);
    slope[0] = -axis(normal, u) / n, slope[1] = -axis(normal, v) / n;
    base = height[0] - slope[0] * at[0][0] - slope[1] * at[0][1];
    const float turn = n > 0 ? 1.f : -1.f;
    for (int i = 0; i < 3; ++i) {
      const float(&a)[2] = at[i], (&b)[2] = at[(i + 1) % 3];
      edge[i][0] = turn * (a[1] - b[1]), edge[i][1] = turn * (b[0] - a[0]);
      edge[i][2] = -edge[i][0] * a[0] - edge[i][1] * a[1];
    }
    for (int c = 0; c < 2; ++c) {
      low[c] = std::min({at[0][c], at[1][c], at[2][c]});
      high[c] = std::max({at[0][c], at[1][c], at[2][c]});
    }
    lowest = std::min({height[0], height[1], height[2]});
    highest = std::max({height[0], height[1], height[2]});
  }

  /// Returns whether the middle of the unit square at (x, y) lies within the triangle, or whether
  /// the square touches it at all, as far as its edges tell.
  bool covers_middle(float x, float y) const { return is_inside(x + 0.5f, y + 0.5f, 0); }
  bool touches(float x, float y) const { return is_inside(x + 0.5f, y + 0.5f, 0.5f); }
  float height_at(float x, float y) const { return base + slope[0] * x + slope[1] * y; }

 private:
  bool is_inside(float x, float y, float reach) const {
    for (const float(&e)[3] : edge)
      if (e[0] * x + e[1] * y + e[2] + reach * (std::abs(e[0]) + std::abs(e[1])) < 0) return false;
    return true;
  }
};

}  // namespace

double VoxelGrid::memory(std::uint32_t along_longest) {
  const double side = along_longest;
  return side * side * side / 8;
}

proto::Expected<VoxelGrid> VoxelGrid::build(const scene::Scene& scene, std::uint32_t along_longest,
                                            VoxelFill fill, std::stop_token stop) {
  constexpr float kMost = std::numeric_limits<float>::max();
  Vec3 low{kMost, kMost, kMost}, high{-kMost, -kMost, -kMost};
  for (const Vec3 p : scene.positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  VoxelGrid grid;
  if (scene.positions.empty()) return grid;
  grid.low_ = low;
  const Vec3 extent = high - low;
  grid.longest_ = std::max({extent.x, extent.y, extent.z});
  grid.side_ = std::max(grid.longest_ / float(along_longest), std::numeric_limits<float>::min());
  std::size_t count = 1;
  for (int a = 0; a < 3; ++a) {
    const float voxels = std::ceil(axis(extent, a) / grid.side_);
    grid.size_[a] = std::int32_t(std::clamp(voxels, 1.f, float(along_longest)));
    count *= std::size_t(grid.size_[a]);
  }
  grid.bits_.assign((count + 63) / 64, 0);
  for (std::size_t t = 0; t < scene.triangles.size(); ++t) {
    if (t % kRunTriangles == 0 && stop.stop_requested()) return proto::canceled();
    const auto& [a, b, c] = scene.triangles[t];
    const Vec3 corners[3] = {grid.in_voxels(scene.positions[a]), grid.in_voxels(scene.positions[b]),
                             grid.in_voxels(scene.positions[c])};
    grid.fill(corners, fill);
  }
  return grid;
}

void VoxelGrid::fill(const Vec3 (&corners)[3], VoxelFill fill) {
  const Vec3 normal = cross(corners[1] - corners[0], corners[2] - corners[0]);
  if (!(dot(normal, normal) > 0)) return;
  const Projected on(corners, normal);
  const auto voxel_of = [&](float c, int a) {
    return std::clamp(std::int32_t(std::floor(c)), 0, size_[a] - 1);
  };
  for (std::int32_t v = voxel_of(on.low[1], on.v); v <= voxel_of(on.high[1], on.v); ++v)
    for (std::int32_t u = voxel_of(on.low[0], on.u); u <= voxel_of(on.high[0], on.u); ++u) {
      const float x = float(u), y = float(v);
      float low = on.height_at(x + 0.5f, y + 0.5f), high = low;
      if (fill == VoxelFill::kDominantAxis) {
        if (!on.covers_middle(x, y)) continue;
      } else {
        if (!on.touches(x, y)) continue;
        const float reach = (std::abs(on.slope[0]) + std::abs(on.slope[1])) / 2;
        low = std::max(low - reach, on.lowest), high = std::min(high + reach, on.highest);
      }
      for (std::int32_t h = voxel_of(low, on.along); h <= voxel_of(high, on.along); ++h) {
        std::int32_t voxel[3];
        voxel[on.u] = u, voxel[on.v] = v, voxel[on.along] = h;
        set(voxel);
      }
    }
}

void VoxelGrid::set(const std::int32_t (&voxel)[3]) {
  const std::size_t i = index(voxel);
  bits_[i / 64] |= std::uint64_t(1) << i % 64;
}

bool VoxelGrid::is_set(const std::int32_t (&voxel)[3]) const {
  for (int a = 0; a < 3; ++a)
    if (voxel[a] < 0 || voxel[a] >= size_[a]) return false;
  const std::size_t i = index(voxel);
  return bits_[i / 64] >> i % 64 & 1;
}

std::uint64_t VoxelGrid::solid_voxels() const {
  std::uint64_t sum = 0;
  for (const std::uint64_t word : bits_) sum += std::uint64_t(std::popcount(word));
  return sum;
}

void VoxelGrid::locate(Vec3 point, std::int32_t (&voxel)[3]) const {
  const Vec3 p = in_voxels(point);
  for (int a = 0; a < 3; ++a) {
    // A point on the upper face of the bounds belongs to the last voxel, which holds that surface.
    const float c = std::floor(axis(p, a)), size = float(size_[a]);
    voxel[a] = c < 0 ? -1 : c > size ? size_[a] : std::min(std::int32_t(c), size_[a] - 1);
  }
}

bool VoxelGrid::is_solid(Vec3 point) const {
  std::int32_t voxel[3];
  locate(point, voxel);
  return is_set(voxel);
}

std::uint32_t VoxelGrid::voxel_of(Vec3 point) const {
  std::int32_t voxel[3];
  locate(point, voxel);
  for (int a = 0; a < 3; ++a) voxel[a] = std::clamp(voxel[a], 0, size_[a] - 1);
  return std::uint32_t(index(voxel));
}

bool VoxelGrid::meets_at_steps(Vec3 from, Vec3 to, std::uint32_t steps) const {
  for (std::uint32_t s = 0; s < steps; ++s)
    if (is_solid(from + (to - from) * ((float(s) + 0.5f) / float(steps)))) return true;
  return false;
}

bool VoxelGrid::meets(Vec3 from, Vec3 to) const {
  const Vec3 a = in_voxels(from), way = in_voxels(to) - a;
  std::int32_t voxel[3], step[3], last[3];
  float next[3], delta[3];
  constexpr float kNever = std::numeric_limits<float>::infinity();
  std::int32_t left = 0;  // voxels that the segment still enters
  for (int c = 0; c < 3; ++c) {
    const float start = axis(a, c), d = axis(way, c);
    const auto clamped = [&](float at) {
      return std::clamp(std::int32_t(std::floor(at)), 0, size_[c] - 1);
    };
    voxel[c] = clamped(std::clamp(start, 0.f, float(size_[c])));
    last[c] = clamped(std::clamp(start + d, 0.f, float(size_[c])));
    step[c] = d > 0 ? 1 : -1;
    delta[c] = d != 0 ? std::abs(1 / d) : kNever;
    const bool moves = voxel[c] != last[c];
    next[c] = moves ? (float(voxel[c] + (d > 0)) - start) / d : kNever;
    left += std::abs(last[c] - voxel[c]);
  }
  for (;; --left) {
    if (is_set(voxel)) return true;
    if (left == 0) return false;
    int c = next[0] <= next[1] ? 0 : 1;
    if (next[2] < next[c]) c = 2;
    voxel[c] += step[c], next[c] += delta[c];
    if (voxel[c] == last[c]) next[c] = kNever;
  }
}

}  // namespace kiln::trace
