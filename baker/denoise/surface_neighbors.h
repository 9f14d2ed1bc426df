#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/exec/workers.h"

namespace kiln::denoise {

/// The texels around each texel on the surface: those of its own chart by their place on the page,
/// and where the chart ends those that go on behind its edge, by their place in the world.
class SurfaceNeighbors {
 public:
  static constexpr int kReach = 2, kSide = 2 * kReach + 1, kCount = kSide * kSide;
  static constexpr int kSelf = kCount / 2;
  using Around = std::array<std::int32_t, kCount>;

  explicit SurfaceNeighbors(const atlas::TextureGroup& texels) : texels_(texels) {}
  /// Looks for what lies behind the charts' edges. Returns false when stopped.
  bool link(const exec::Workers&);

  /// The square of texels around one, row by row, itself in the middle; kNoTexel where there is
  /// none.
  Around of(std::uint32_t texel) const;

 private:
  const atlas::TextureGroup& texels_;
  std::vector<std::uint32_t> edge_;  ///< per texel: its place in `linked_`, or kInside
  std::vector<Around> linked_;       ///< the texels around each texel near an edge
};

}  // namespace kiln::denoise
