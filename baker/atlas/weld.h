#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/scene/scene.h"

namespace kiln::atlas {

/// The triangles of one instance as a surface: which of them meet along an edge.
struct Surface {
  static constexpr std::uint32_t kNone = 0xffffffffu;

  std::vector<std::uint32_t> triangles;  ///< indices into Scene::triangles, ascending
  /// Per triangle and edge (k to k+1): the neighbour's place in `triangles`, or kNone where there
  /// is none, more than one, one of opposite winding, or one of other sidedness (a texel is
  /// double-sided or it is not).
  std::vector<std::array<std::uint32_t, 3>> neighbour;
};

/// What makes two vertices one.
enum class WeldBy {
  kPosition,       ///< equal position
  kPositionAndUv,  ///< equal position and equal TEXCOORD_1: neighbours are neighbours on the page
};
/// For kPositionAndUv, neighbours may have either winding: a fold is still one piece. An empty
/// surface when stopped.
Surface weld(const scene::Scene&, const scene::Instance&, WeldBy, const std::stop_token&);

/// Numbers the connected pieces from 0 in order of their first triangle; one entry per triangle of
/// the surface. Nothing when stopped.
std::vector<std::uint32_t> connected_pieces(const Surface&, std::uint32_t* count,
                                            const std::stop_token&);

}  // namespace kiln::atlas
