#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/solver/pairwise/patches.h"

namespace kiln::solver::links {

/// The texels as a tree of groups: a quadtree over each side of each chart, aligned to the page,
/// and above their roots a binary tree of charts that lie near to each other [Hanrahan, Salzman and
/// Aupperle, SIGGRAPH 1991; Smits, Arvo and Greenberg, SIGGRAPH 1994]. Immutable; callable from
/// many threads.
///
/// A member of the tree is a group or a single texel, and has an Id.
class LinkTree {
 public:
  using Id = std::uint32_t;
  /// Groups of receivers are at most so many texels wide, so that they are found from few texels.
  static constexpr std::uint32_t kReceiverSide = 8;

  /// Where the texels of a group lie.
  struct Bounds {
    math::Vec3 center;    ///< m
    float radius = 0;     ///< m: of a sphere that holds their middles
    math::Vec3 normal;    ///< unit, if is_flat
    float thickness = 0;  ///< m: along the normal, to either side of the center
    bool is_flat = false;
    float area_m2 = 0;
  };

  /// @param texels, patches outlive this
  LinkTree(const atlas::TextureGroup& texels, const pairwise::Patches& patches);
  static double memory_per_texel();

  std::uint32_t groups() const { return std::uint32_t(nodes_.size()); }
  /// Returns the group of all texels. The tree must not be empty.
  Id root() const { return 0; }
  bool is_texel(Id id) const { return id >= groups(); }
  std::uint32_t texel(Id id) const { return id - groups(); }
  Id id_of(std::uint32_t texel) const { return groups() + texel; }

  /// Returns the texels of a group.
  std::span<const std::uint32_t> texels(Id group) const {
    const Node& n = nodes_[group];
    return {order_.data() + n.begin, n.end - n.begin};
  }
  const Bounds& bounds(Id group) const { return nodes_[group].bounds; }
  /// Returns the number of members that a group consists of, and the k-th of them.
  std::uint32_t children(Id group) const {
    const Node& n = nodes_[group];
    return n.child_count > 0 ? n.child_count : n.end - n.begin;
  }
  Id child(Id group, std::uint32_t k) const;

  /// Returns the largest receivers that together have the texels of a range, and maybe others, in
  /// a fixed order.
  std::vector<Id> receivers(atlas::TexelRange) const;

 private:
  struct Node {
    std::uint32_t begin = 0, end = 0;  ///< of order_
    std::uint32_t first_child = 0, child_count = 0;
    Bounds bounds;
  };
  class Builder;

  Id id_of_group(std::uint32_t node) const;

  std::vector<Node> nodes_;                 ///< a node follows its parent
  std::vector<std::uint32_t> order_;        ///< texels, by groups
  std::vector<std::uint32_t> receiver_of_;  ///< of texels: the node of their largest receiver
};

}  // namespace kiln::solver::links
