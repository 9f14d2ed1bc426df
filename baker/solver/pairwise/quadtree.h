#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/solver/pairwise/patches.h"
#include "baker/solver/pairwise/windows.h"

namespace kiln::solver::pairwise {

/// A quadtree over every chart, and over its back, whose leaves are squares of texels that are
/// alike [RTRad alg. 5]. Nodes are aligned to the page. Built from single texels up: the four
/// children of a node become one leaf if none of them is split and the node's gradient is below the
/// threshold. A child outside of the chart does not count. Immutable.
///
/// The gradient is that of RTRad's eq. 5.2, for the texel of the node where it is largest:
///
///   max_t 1/2 |B_t - mean B| / k + 1/2 |n_t - mean n|
///
/// Means are weighted by area, over all texels of the node; as printed, the equation compares one
/// child with the four. So no texel of a leaf differs from what the leaf sends by more than the
/// threshold. B / k is radiosity in 0..1, where k is the brightest channel of all texels.
class Quadtree {
 public:
  /// The texels of a leaf, as a part of texels().
  struct Leaf {
    std::uint32_t begin = 0, end = 0;
    std::uint32_t side = 1;  ///< of its square
  };

  /// When stopped, it ends early and must not be used. @param windows as large as the largest leaf,
  /// a power of two; outlives this
  Quadtree(const atlas::TextureGroup&, const Patches&, const Windows& windows, std::uint32_t side,
           std::span<const math::Rgb> radiosity, float threshold, const std::stop_token&);

  /// Returns all leaves, in the order of their first texels.
  std::span<const Leaf> leaves() const { return leaves_; }
  /// Returns the texels of a leaf, each of which is in no other.
  std::span<const std::uint32_t> texels(const Leaf& leaf) const {
    return {order_.data() + leaf.begin, leaf.end - leaf.begin};
  }

 private:
  std::vector<std::uint32_t> order_;  ///< texels, by leaves
  std::vector<Leaf> leaves_;
};

}  // namespace kiln::solver::pairwise
