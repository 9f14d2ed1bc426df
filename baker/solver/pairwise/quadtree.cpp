#include "baker/solver/pairwise/quadtree.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace kiln::solver::pairwise {
namespace {

using Leaf = Quadtree::Leaf;

/// Returns a place within a square by its position on the Z-shaped curve, on which every node of a
/// quadtree is one piece.
std::uint32_t curve_place(std::uint32_t x, std::uint32_t y) {
  std::uint32_t place = 0;
  for (std::uint32_t bit = 0; bit < 8; ++bit)
    place |= (x >> bit & 1) << 2 * bit | (y >> bit & 1) << (2 * bit + 1);
  return place;
}

float brightest(std::span<const math::Rgb> radiosity) {
  float most = 0;
  for (const math::Rgb& b : radiosity) most = std::max(most, max_channel(b));
  return most;
}

/// A texel as a tree over one window of one chart sees it.
struct Item {
  std::uint32_t chart = 0, place = 0;  ///< place on the curve
  std::uint32_t texel = 0;
  float area_m2 = 0;
  math::Vec3 normal, color;  ///< B / k

  auto key() const { return std::tie(chart, place); }
};

/// Builds the tree of one window.
class Tree {
 public:
  Tree(std::span<const Item> items, float threshold, std::vector<Leaf>& leaves)
      : items_(items), threshold_(threshold), leaves_(leaves) {}

  /// Adds the leaves of the node that holds these items, which are of one chart and not none.
  /// Returns whether it is one leaf.
  bool grow(std::uint32_t begin, std::uint32_t end, std::uint32_t side) {
    if (side == 1) {
      leaves_.push_back({begin, end, side});
      return true;
    }
    const std::size_t before = leaves_.size();
    const std::uint32_t quarter = side / 2 * (side / 2);
    bool whole = true;
    for (std::uint32_t at = begin; at < end;) {
      const std::uint32_t child = items_[at].place / quarter;
      std::uint32_t stop = at;
      while (stop < end && items_[stop].place / quarter == child) ++stop;
      whole = grow(at, stop, side / 2) && whole;
      at = stop;
    }
    if (!whole || !(gradient(begin, end) < double(threshold_))) return false;
    leaves_.resize(before);
    leaves_.push_back({begin, end, side});
    return true;
  }

 private:
  /// RTRad's eq. 5.2 over the node.
  double gradient(std::uint32_t begin, std::uint32_t end) const {
    double area = 0;
    math::Vec3d normal, color;
    for (const Item& item : items_.subspan(begin, end - begin)) {
      area += double(item.area_m2);
      normal += to_double(item.normal) * double(item.area_m2);
      color += to_double(item.color) * double(item.area_m2);
    }
    if (!(area > 0)) return 0;
    normal = normal * (1 / area), color = color * (1 / area);
    double most = 0;
    for (const Item& item : items_.subspan(begin, end - begin))
      most = std::max(most, length(to_double(item.color) - color) / 2 +
                                length(to_double(item.normal) - normal) / 2);
    return most;
  }

  const std::span<const Item> items_;
  const float threshold_;
  std::vector<Leaf>& leaves_;
};

}  // namespace

Quadtree::Quadtree(const atlas::TextureGroup& texels, const Patches& patches,
                   const Windows& windows, std::uint32_t side, std::span<const math::Rgb> radiosity,
                   float threshold, const std::stop_token& stop) {
  const float k = brightest(radiosity), scale = k > 0 ? 1 / k : 0;
  order_.reserve(texels.size());
  std::vector<Item> items;
  std::vector<Leaf> own;
  for (std::uint32_t w = 0; w < windows.size(); ++w) {
    if (stop.stop_requested()) return;
    items.clear(), own.clear();
    for (const std::uint32_t t : windows.texels(w)) {
      const math::Rgb b = radiosity[t] * scale;
      items.push_back({texels.chart[t],
                       curve_place(texels.x[t] % side, texels.y[t] % side),
                       t,
                       texels.area_m2[t],
                       patches.point(t, 0).geometric_normal,
                       {b.r, b.g, b.b}});
    }
    std::ranges::sort(items, {}, &Item::key);
    Tree tree(items, threshold, own);
    for (std::uint32_t at = 0, end = 0; at < items.size(); at = end) {
      while (end < items.size() && items[end].chart == items[at].chart) ++end;
      tree.grow(at, end, side);
    }
    const auto first = std::uint32_t(order_.size());
    for (const Item& item : items) order_.push_back(item.texel);
    for (const Leaf& leaf : own) {
      std::sort(order_.begin() + first + leaf.begin, order_.begin() + first + leaf.end);
      leaves_.push_back({first + leaf.begin, first + leaf.end, leaf.side});
    }
  }
  std::ranges::sort(leaves_, {}, [&](const Leaf& leaf) { return order_[leaf.begin]; });
}

}  // namespace kiln::solver::pairwise
