#pragma once

#include <cstdint>
#include <utility>

#include "baker/trace/ray_scene.h"
#include "baker/trace/voxel_grid.h"

namespace kiln::trace {

/// Tells whether two points see each other [RTRad eq. 4.5]. Immutable; callable from many threads.
class Visibility {
 public:
  virtual ~Visibility() = default;
  /// Bit i is set when something lies between the two ends of segment i. The ends are points just
  /// off the surfaces that they stand for, see RayScene::offset_origin().
  virtual std::uint32_t blocked(const SegmentPacket&) const = 0;
};

/// Traces the segments, see RayScene::blocked().
class RayVisibility final : public Visibility {
 public:
  /// @param scene outlives this
  /// @param coherent a promise about the segments of a packet, for speed only
  explicit RayVisibility(const RayScene& scene, bool coherent = true)
      : scene_(scene), coherent_(coherent) {}
  std::uint32_t blocked(const SegmentPacket& segments) const override {
    return scene_.blocked(segments, coherent_);
  }

 private:
  const RayScene& scene_;
  const bool coherent_;
};

/// Marches segments through voxels instead of tracing rays [RTRad 5.3]. It knows surfaces to a
/// voxel only: what is nearer to an end than some voxels is not seen, and what a segment passes
/// within a voxel blocks it.
class VoxelVisibility final : public Visibility {
 public:
  enum class March {
    /// kSteps points, evenly spaced. Both ends are pulled in by a share of the scene's longest
    /// side,
    /// as in RTRad's program.
    kFixedSteps,
    /// Every voxel on the way. Both ends are pulled in by kExactEnds voxels.
    kExact,
  };
  static constexpr std::uint32_t kSteps = 128;
  static constexpr float kFixedEnds = 0.035f;  ///< of the scene's longest side
  static constexpr float kExactEnds = 2;       ///< voxels

  /// @param ratio share of the segments that march; rays are traced for the others. Which ones is
  ///        a matter of their ends alone.
  /// @param scene outlives this
  VoxelVisibility(VoxelGrid grid, March march, float ratio, const RayScene& scene)
      : grid_(std::move(grid)), march_(march), ratio_(ratio), rays_(scene) {}
  std::uint32_t blocked(const SegmentPacket&) const override;

 private:
  bool is_blocked(math::Vec3 from, math::Vec3 to) const;

  const VoxelGrid grid_;
  const March march_;
  const float ratio_;
  const RayVisibility rays_;
};

}  // namespace kiln::trace
