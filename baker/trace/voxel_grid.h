#pragma once

#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/math/vec.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::trace {

/// Which voxels a triangle fills.
enum class VoxelFill {
  /// One in each column along the main axis of its normal whose middle it covers, as a rasterizer
  /// does it [RTRad 5.3.2, alg. 7]. Surfaces have holes where voxels meet at corners only.
  kDominantAxis,
  /// All that it touches, and some around its corners.
  kConservative,
};

/// A grid of cubes over a scene, one bit each: set where a surface lies [RTRad 5.3.2]. It takes the
/// cube of `along_longest` bits, at most. Immutable; callable from many threads.
class VoxelGrid {
 public:
  /// @param along_longest voxels along the longest side of the scene's bounds, 1 to 1024
  /// Errors: `canceled`.
  static proto::Expected<VoxelGrid> build(const scene::Scene&, std::uint32_t along_longest,
                                          VoxelFill, std::stop_token = {});
  /// Returns the bytes of such a grid, at most.
  static double memory(std::uint32_t along_longest);

  float voxel_m() const { return side_; }       ///< side of a voxel, m
  float longest_m() const { return longest_; }  ///< longest side of the scene's bounds, m
  std::uint64_t solid_voxels() const;

  /// Returns whether the voxel around a point is solid; there are none outside.
  bool is_solid(math::Vec3 point) const;
  /// Returns the number of the voxel around a point of the scene, which must have some. A point
  /// outside of the grid has the nearest voxel: rounding may take a point of a wall there.
  std::uint32_t voxel_of(math::Vec3 point) const;
  bool is_solid_voxel(std::uint32_t voxel) const { return bits_[voxel / 64] >> voxel % 64 & 1; }

  /// Returns whether one of `steps` points, evenly spaced from one end to the other, lies in a
  /// solid voxel [RTRad 5.3.1, fig. 5.7].
  bool meets_at_steps(math::Vec3 from, math::Vec3 to, std::uint32_t steps) const;
  /// Returns whether the segment goes through a solid voxel. It visits every voxel on its way
  /// [Amanatides and Woo, Eurographics 1987].
  bool meets(math::Vec3 from, math::Vec3 to) const;

 private:
  void fill(const math::Vec3 (&corners)[3], VoxelFill);
  void set(const std::int32_t (&voxel)[3]);
  bool is_set(const std::int32_t (&voxel)[3]) const;
  /// Finds the voxel around a point; one that is outside lies beyond the grid's ends.
  void locate(math::Vec3 point, std::int32_t (&voxel)[3]) const;
  std::size_t index(const std::int32_t (&voxel)[3]) const {
    return (std::size_t(voxel[2]) * size_[1] + std::size_t(voxel[1])) * size_[0] +
           std::size_t(voxel[0]);
  }
  math::Vec3 in_voxels(math::Vec3 point) const { return (point - low_) * (1 / side_); }

  math::Vec3 low_;
  float side_ = 1, longest_ = 0;
  std::int32_t size_[3] = {};
  std::vector<std::uint64_t> bits_;  ///< x runs fastest
};

}  // namespace kiln::trace
