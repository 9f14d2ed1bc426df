#include "baker/solver/links/link_tree.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

namespace kiln::solver::links {
namespace {

using math::Vec3;

constexpr std::uint32_t kNoReceiver = 0xffffffff;

/// Holds the texels of one side of one chart, as a part of all that are sorted.
struct Sheet {
  std::uint32_t begin = 0, end = 0;
  Vec3 center;
};

std::uint32_t spread_bits(std::uint32_t x) {
  x = (x | x << 8) & 0x00ff00ff;
  x = (x | x << 4) & 0x0f0f0f0f;
  x = (x | x << 2) & 0x33333333;
  return (x | x << 1) & 0x55555555;
}
/// Returns the place of a texel on a Z-shaped curve, on which every square of a quadtree is one
/// piece.
std::uint32_t curve_place(const atlas::TextureGroup& texels, std::uint32_t t) {
  return spread_bits(texels.x[t]) | spread_bits(texels.y[t]) << 1;
}

LinkTree::Bounds bounds_of(std::span<const std::uint32_t> group, const atlas::TextureGroup& texels,
                           const pairwise::Patches& patches) {
  constexpr float kFlat = 0.9999f;  // the least cosine between a normal and their mean
  LinkTree::Bounds b;
  double area = 0;
  math::Vec3d center, normal;
  Vec3 low = texels.position[group[0]], high = low;
  for (const std::uint32_t t : group) {
    const Vec3 p = texels.position[t];
    area += double(texels.area_m2[t]);
    normal += to_double(patches.point(t, 0).geometric_normal) * double(texels.area_m2[t]);
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  b.area_m2 = float(area);
  b.center = (low + high) * 0.5f;
  b.normal = normalize(Vec3{float(normal.x), float(normal.y), float(normal.z)});
  b.is_flat = true;
  for (const std::uint32_t t : group) {
    const Vec3 way = texels.position[t] - b.center;
    b.radius = std::max(b.radius, length(way));
    b.thickness = std::max(b.thickness, std::abs(dot(way, b.normal)));
    b.is_flat = b.is_flat && dot(patches.point(t, 0).geometric_normal, b.normal) > kFlat;
  }
  return b;
}

}  // namespace

/// Makes the nodes from the root down, so that the children of a node follow each other.
class LinkTree::Builder {
 public:
  Builder(LinkTree& tree, const atlas::TextureGroup& texels, const pairwise::Patches& patches)
      : tree_(tree), texels_(texels), patches_(patches) {}

  void build() {
    sort_texels();
    if (sheets_.empty()) return;
    add({0, std::uint32_t(sheets_.size()), 0, 0, 0});
    for (std::size_t at = 0; at < plans_.size(); ++at) split(std::uint32_t(at));
  }

 private:
  /// Says what a node is made from: several sheets, or a square of one.
  struct Plan {
    std::uint32_t first_sheet = 0, last_sheet = 0;  ///< half open; none: a square
    std::uint32_t begin = 0, end = 0, side = 0;     ///< of order_; texels
  };

  void sort_texels() {
    std::vector<std::uint32_t> sorted(texels_.size());
    std::iota(sorted.begin(), sorted.end(), 0u);
    const auto key = [&](std::uint32_t t) {
      return std::tuple(texels_.chart[t], texels_.is_back(t), texels_.page[t],
                        curve_place(texels_, t));
    };
    std::ranges::sort(sorted, {}, key);
    const auto same_sheet = [&](std::uint32_t a, std::uint32_t b) {
      return texels_.chart[a] == texels_.chart[b] && texels_.is_back(a) == texels_.is_back(b) &&
             texels_.page[a] == texels_.page[b];
    };
    for (std::uint32_t at = 0, end = 0; at < sorted.size(); at = end) {
      Sheet sheet;
      while (end < sorted.size() && same_sheet(sorted[at], sorted[end])) ++end;
      sheet.begin = at, sheet.end = end;
      for (std::uint32_t i = at; i < end; ++i) sheet.center += texels_.position[sorted[i]];
      sheet.center = sheet.center * (1 / float(end - at));
      sheets_.push_back(sheet);
    }
    cluster(0, std::uint32_t(sheets_.size()));
    tree_.order_.reserve(sorted.size());
    for (Sheet& sheet : sheets_) {
      const auto begin = std::uint32_t(tree_.order_.size());
      tree_.order_.insert(tree_.order_.end(), sorted.begin() + sheet.begin,
                          sorted.begin() + sheet.end);
      sheet.begin = begin, sheet.end = std::uint32_t(tree_.order_.size());
    }
  }

  /// Orders sheets so that the halves of each part lie apart along its longest side.
  void cluster(std::uint32_t begin, std::uint32_t end) {
    if (end - begin < 2) return;
    Vec3 low = sheets_[begin].center, high = low;
    for (std::uint32_t s = begin; s < end; ++s) {
      const Vec3 c = sheets_[s].center;
      low = {std::min(low.x, c.x), std::min(low.y, c.y), std::min(low.z, c.z)};
      high = {std::max(high.x, c.x), std::max(high.y, c.y), std::max(high.z, c.z)};
    }
    const Vec3 size = high - low;
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    std::stable_sort(
        sheets_.begin() + begin, sheets_.begin() + end,
        [&](const Sheet& a, const Sheet& b) { return a.center[axis] < b.center[axis]; });
    const std::uint32_t middle = begin + (end - begin) / 2;
    cluster(begin, middle);
    cluster(middle, end);
  }

  void add(Plan plan) {
    if (plan.first_sheet < plan.last_sheet) {
      plan.begin = sheets_[plan.first_sheet].begin, plan.end = sheets_[plan.last_sheet - 1].end;
      if (plan.last_sheet - plan.first_sheet == 1) {
        plan.first_sheet = plan.last_sheet = 0;
        plan.side = side_of(plan.begin, plan.end);
      }
    }
    plans_.push_back(plan);
    const std::span<const std::uint32_t> group(tree_.order_.data() + plan.begin,
                                               plan.end - plan.begin);
    tree_.nodes_.push_back({plan.begin, plan.end, 0, 0, bounds_of(group, texels_, patches_)});
  }

  /// Returns the side of the smallest square of the quadtree that holds some texels of a sheet.
  std::uint32_t side_of(std::uint32_t begin, std::uint32_t end) const {
    const std::uint32_t apart =
        curve_place(texels_, tree_.order_[begin]) ^ curve_place(texels_, tree_.order_[end - 1]);
    return 1u << (std::bit_width(apart) + 1) / 2;
  }

  void split(std::uint32_t node) {
    const Plan plan = plans_[node];
    const auto first = std::uint32_t(plans_.size());
    if (plan.first_sheet < plan.last_sheet) {
      const std::uint32_t middle = plan.first_sheet + (plan.last_sheet - plan.first_sheet) / 2;
      add({plan.first_sheet, middle, 0, 0, 0});
      add({middle, plan.last_sheet, 0, 0, 0});
    } else {
      if (plan.side <= kReceiverSide) mark_receiver(node);
      if (plan.side > 2) split_square(plan);
    }
    tree_.nodes_[node].first_child = first;
    tree_.nodes_[node].child_count = std::uint32_t(plans_.size()) - first;
  }

  void split_square(const Plan& plan) {
    const std::uint32_t quarter = plan.side / 2 * (plan.side / 2);
    for (std::uint32_t at = plan.begin, end = at; at < plan.end; at = end) {
      const std::uint32_t square = curve_place(texels_, tree_.order_[at]) / quarter;
      while (end < plan.end && curve_place(texels_, tree_.order_[end]) / quarter == square) ++end;
      add({0, 0, at, end, side_of(at, end)});
    }
  }

  /// Makes a node the receiver of its texels, unless a larger one around it is.
  void mark_receiver(std::uint32_t node) {
    const auto texels = tree_.texels(node);
    if (tree_.receiver_of_[texels.front()] != kNoReceiver) return;
    for (const std::uint32_t t : texels) tree_.receiver_of_[t] = node;
  }

  LinkTree& tree_;
  const atlas::TextureGroup& texels_;
  const pairwise::Patches& patches_;
  std::vector<Sheet> sheets_;
  std::vector<Plan> plans_;
};

LinkTree::LinkTree(const atlas::TextureGroup& texels, const pairwise::Patches& patches)
    : receiver_of_(texels.size(), kNoReceiver) {
  Builder(*this, texels, patches).build();
}

double LinkTree::memory_per_texel() {
  // A square of a quadtree has four children, or less at the edges of charts: about every second
  // texel brings a node. While the tree is built, a node has a plan too.
  constexpr double kNodes = 0.6, kPlan = 20;
  return kNodes * (double(sizeof(Node)) + kPlan) + 3 * sizeof(std::uint32_t);
}

LinkTree::Id LinkTree::id_of_group(std::uint32_t node) const {
  const Node& n = nodes_[node];
  return n.end - n.begin == 1 ? id_of(order_[n.begin]) : node;
}

LinkTree::Id LinkTree::child(Id group, std::uint32_t k) const {
  const Node& n = nodes_[group];
  return n.child_count > 0 ? id_of_group(n.first_child + k) : id_of(order_[n.begin + k]);
}

std::vector<LinkTree::Id> LinkTree::receivers(atlas::TexelRange range) const {
  std::vector<std::uint32_t> nodes(receiver_of_.begin() + range.begin,
                                   receiver_of_.begin() + range.end);
  std::ranges::sort(nodes);
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  std::ranges::transform(nodes, nodes.begin(), [&](std::uint32_t n) { return id_of_group(n); });
  return nodes;
}

}  // namespace kiln::solver::links
