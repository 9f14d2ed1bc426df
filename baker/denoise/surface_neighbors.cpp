#include "baker/denoise/surface_neighbors.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace kiln::denoise {
namespace {

constexpr std::uint32_t kInside = 0xffffffffu;
/// A texel behind the edge must lie this near to where the chart would go on, in texels, and be
/// turned like the one before it (least cosine).
constexpr float kNear = 0.75f, kSameTurn = 0.9f;
constexpr std::uint32_t kRunTexels = 4096;

float side_of(const atlas::TextureGroup& texels, std::uint32_t t) {
  return std::sqrt(texels.area_m2[t] / texels.coverage[t]);
}

/// Holds texels by the cube of the world that they lie in.
class WorldGrid {
 public:
  WorldGrid(const atlas::TextureGroup& texels, const std::vector<std::uint32_t>& members,
            float cell)
      : texels_(texels), scale_(1 / cell) {
    for (const std::uint32_t t : members) entries_.push_back({key(cell_of(texels.position[t])), t});
    std::sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) {
      return a.key != b.key ? a.key < b.key : a.texel < b.texel;
    });
  }

  /// Calls `use(texel)` for those in the cubes within half a cube of the point.
  template <class Use>
  void near(math::Vec3 p, const Use& use) const {
    const Cell low = cell_of(p - math::Vec3{0.5f, 0.5f, 0.5f} * (1 / scale_));
    for (int k = 0; k < 8; ++k) {
      const std::uint64_t wanted =
          key({low[0] + (k & 1), low[1] + (k >> 1 & 1), low[2] + (k >> 2)});
      const auto less = [](const Entry& e, std::uint64_t value) { return e.key < value; };
      for (auto e = std::lower_bound(entries_.begin(), entries_.end(), wanted, less);
           e != entries_.end() && e->key == wanted; ++e)
        use(e->texel);
    }
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  struct Entry {
    std::uint64_t key;
    std::uint32_t texel;
  };

  Cell cell_of(math::Vec3 p) const {
    // This is far beyond any atlas's resolution; all cells are one then.
    const auto index = [&](float x) {
      return std::int64_t(std::clamp(std::floor(x * scale_), -1e9f, 1e9f));
    };
    return {index(p.x), index(p.y), index(p.z)};
  }
  static std::uint64_t key(const Cell& c) {
    std::uint64_t h = 0;
    for (const std::int64_t i : c) {
      h = (h ^ std::uint64_t(i)) * 0x9e3779b97f4a7c15u;
      h ^= h >> 29;
    }
    return h;
  }

  const atlas::TextureGroup& texels_;
  const float scale_;
  std::vector<Entry> entries_;
};

/// A step of one texel along the page, in the world, where the chart shows it.
std::optional<math::Vec3> step(const atlas::TextureGroup& texels, std::uint32_t t, int dx, int dy) {
  const std::int32_t after = texels.neighbor(t, dx, dy), before = texels.neighbor(t, -dx, -dy);
  const math::Vec3 p = texels.position[t];
  if (after != atlas::kNoTexel && before != atlas::kNoTexel)
    return (texels.position[after] - texels.position[before]) * 0.5f;
  if (after != atlas::kNoTexel) return texels.position[after] - p;
  if (before != atlas::kNoTexel) return p - texels.position[before];
  return std::nullopt;
}

/// The texel of another chart that lies nearest to the place, near enough and turned as `from` is.
std::int32_t find(const atlas::TextureGroup& texels, const WorldGrid& grid, std::uint32_t from,
                  math::Vec3 place, float side) {
  std::int32_t best = atlas::kNoTexel;
  float best_distance = kNear * kNear * side * side;
  grid.near(place, [&](std::uint32_t t) {
    if (texels.chart[t] == texels.chart[from] ||
        dot(texels.shading_normal[t], texels.shading_normal[from]) < kSameTurn)
      return;
    const math::Vec3 d = texels.position[t] - place;
    const float distance = dot(d, d);
    // Cubes may be met twice where their keys meet: the first of equals stays.
    if (distance < best_distance) best = std::int32_t(t), best_distance = distance;
  });
  return best;
}

}  // namespace

bool SurfaceNeighbors::link(const exec::Workers& workers) {
  edge_.assign(texels_.size(), kInside);
  linked_.clear();
  const bool looked = workers.for_runs(texels_.size(), kRunTexels, [&](auto begin, auto end) {
    for (std::uint32_t t = begin; t < end; ++t)
      for (int k = 0; k < kCount && edge_[t] == kInside; ++k)
        if (texels_.neighbor(t, k % kSide - kReach, k / kSide - kReach) == atlas::kNoTexel)
          edge_[t] = 0;
  });
  if (!looked) return false;
  std::vector<std::uint32_t> members;
  float widest = 0;
  for (std::uint32_t t = 0; t < texels_.size(); ++t) {
    if (edge_[t] == kInside) continue;
    edge_[t] = std::uint32_t(members.size());
    members.push_back(t);
    widest = std::max(widest, side_of(texels_, t));
  }
  if (members.empty()) return true;
  linked_.resize(members.size());
  // Half a cube reaches as far as a texel may lie from its place.
  const WorldGrid grid(texels_, members, std::max(2 * kNear * widest, 1e-20f));
  return workers.for_runs(
      std::uint32_t(members.size()), kRunTexels / 16, [&](auto begin, auto end) {
        for (std::uint32_t i = begin; i < end; ++i) {
          const std::uint32_t t = members[i];
          const auto right = step(texels_, t, 1, 0), down = step(texels_, t, 0, 1);
          for (int k = 0; k < kCount; ++k) {
            const int dx = k % kSide - kReach, dy = k / kSide - kReach;
            std::int32_t& n = linked_[i][std::size_t(k)];
            n = texels_.neighbor(t, dx, dy);
            if (n != atlas::kNoTexel || !right || !down) continue;
            const math::Vec3 place = texels_.position[t] + *right * float(dx) + *down * float(dy);
            n = find(texels_, grid, t, place, side_of(texels_, t));
          }
        }
      });
}

SurfaceNeighbors::Around SurfaceNeighbors::of(std::uint32_t texel) const {
  if (edge_[texel] != kInside) return linked_[edge_[texel]];
  // All texels are of one chart and inside the page.
  const atlas::TextureGroup::Page& page = texels_.pages[texels_.page[texel]];
  const std::int32_t* corner = page.texel_at.data() +
                               (std::size_t(texels_.y[texel]) - kReach) * page.width +
                               texels_.x[texel] - kReach;
  Around around;
  for (int row = 0; row < kSide; ++row)
    for (int k = 0; k < kSide; ++k)
      around[std::size_t(row * kSide + k)] = corner[std::size_t(row) * page.width + std::size_t(k)];
  if (texels_.is_back(texel))
    for (std::int32_t& n : around) n = texels_.back[n];
  return around;
}

}  // namespace kiln::denoise
