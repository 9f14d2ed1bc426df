#pragma once

#include <cstdint>
#include <memory>
#include <stop_token>

#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::trace {

inline constexpr std::uint32_t kNoHit = 0xffffffffu;

/// Sixteen rays, structure of arrays. Finite in all lanes, active or not (t_far may be infinite):
/// Debian's Embree asserts that, except on AVX-512.
struct alignas(64) RayPacket {
  float org_x[16]{}, org_y[16]{}, org_z[16]{};
  float dir_x[16]{}, dir_y[16]{}, dir_z[16]{};
  float t_far[16]{};
  std::uint32_t active = 0;  ///< bit i: ray i is traced

  void activate_first(std::uint32_t count) { active = (1u << count) - 1; }
  void set(std::uint32_t i, math::Vec3 origin, math::Vec3 direction, float far);
};

struct alignas(64) HitPacket {
  std::uint32_t triangle[16];  ///< kNoHit: none
  float u[16], v[16], t[16];
  std::uint32_t back[16];  ///< 1: met from behind
};

/// Up to sixteen segments, structure of arrays. Finite in all lanes.
struct alignas(64) SegmentPacket {
  float from[3][16]{}, to[3][16]{};  ///< x, y, z; m
  std::uint32_t count = 0;           ///< the first so many are asked about

  bool is_full() const { return count == 16; }
  void add(math::Vec3 a, math::Vec3 b) { set(count++, a, b); }
  void set(std::uint32_t i, math::Vec3 a, math::Vec3 b) {
    from[0][i] = a.x, from[1][i] = a.y, from[2][i] = a.z;
    to[0][i] = b.x, to[1][i] = b.y, to[2][i] = b.z;
  }
  math::Vec3 start(std::uint32_t i) const { return {from[0][i], from[1][i], from[2][i]}; }
  math::Vec3 end(std::uint32_t i) const { return {to[0][i], to[1][i], to[2][i]}; }
};

/// The scene's triangles under an Embree BVH. Immutable; callable from many threads.
class RayScene {
 public:
  static proto::Expected<RayScene> build(const scene::Scene&, std::stop_token = {});
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;
  ~RayScene();

  /// Closest hits; lanes that are not active have none. `coherent` is a promise about the packet,
  /// for speed only.
  void closest(const RayPacket&, HitPacket&, bool coherent = false) const;
  /// Bit i is set when anything, seen from either side, lies on ray i before t_far.
  std::uint32_t occluded(const RayPacket&, bool coherent = false) const;
  /// Bit i is set when something lies between the two ends of segment i. A ray begins ε after the
  /// one end and stops ε before the other [RTRad 4.7.1]: neither end is met by rounding. What is
  /// shorter than 2ε is open. ε is offset() at the end that is farther from the origin. Which end
  /// is the first makes no difference but for rounding.
  std::uint32_t blocked(const SegmentPacket&, bool coherent = false) const;

  /// Returns the memory that Embree holds for the scene: its tree, and its copies of vertices and
  /// triangles. Bytes.
  std::uint64_t memory_bytes() const;
  /// Returns at least as much as a build takes at its peak, beside the scene itself. Bytes.
  static std::uint64_t build_bytes(const scene::Scene&);

  /// Rays keep off a surface by this share of the largest coordinate, about 32 ulp, and at least by
  /// that share of the scene's longest side. Below 8 ulp surfaces shadow themselves, and beyond a
  /// fiftieth of a texel contact shadows leak.
  static constexpr float kOffset = 0x1p-18f;
  /// Returns the distance, m, by which rays that begin at a point keep off its surface.
  float offset(math::Vec3 position) const;
  /// `position`, a point of a triangle, moved off the surface along `geometric_normal` far enough
  /// that rays don't meet the triangle they start on, and as far towards the triangle's `centroid`,
  /// at most onto it: from an edge rays would start in the plane of the wall that stands on it, and
  /// pass it.
  math::Vec3 offset_origin(math::Vec3 position, math::Vec3 geometric_normal,
                           math::Vec3 centroid) const;

 private:
  struct Impl;
  explicit RayScene(std::unique_ptr<Impl>);
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::trace
