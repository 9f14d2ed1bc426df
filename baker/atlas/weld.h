#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/scene/scene.h"

namespace kiln::atlas {

/// The triangles of one instance as a surface, with the edges along which they meet.
struct Surface {
  static constexpr std::uint32_t kNone = 0xffffffffu;

  std::vector<std::uint32_t> triangles;  ///< indices into Scene::triangles, ascending
  /// Per triangle and edge (k to k+1): the neighbor's place in `triangles`. It is kNone where there
  /// is no neighbor, more than one, one of opposite winding, or one of other sidedness (a texel is
  /// double-sided or it is not).
  std::vector<std::array<std::uint32_t, 3>> neighbor;
};

/// The condition under which two vertices become one.
enum class WeldBy {
  kPosition,       ///< equal position
  kPositionAndUv,  ///< equal position and equal TEXCOORD_1: neighbors are neighbors on the page
};
/// Welds the vertices of an instance and finds the neighbors of its triangles. For kPositionAndUv,
/// neighbors may have either winding: a fold is still one piece. The surface is empty when stopped.
Surface weld(const scene::Scene&, const scene::Instance&, WeldBy, const std::stop_token&);

/// Numbers the connected pieces from 0 in order of their first triangle. Returns one entry per
/// triangle of the surface, or nothing when stopped.
std::vector<std::uint32_t> connected_pieces(const Surface&, std::uint32_t* count,
                                            const std::stop_token&);

}  // namespace kiln::atlas
