#include <array>
#include <optional>

#include "baker/atlas/band_sweep.h"
#include "baker/atlas/sample_points.h"
#include "baker/atlas/texture_group.h"
#include "baker/exec/stop.h"

namespace kiln::baker {
namespace {

using namespace atlas_detail;

constexpr std::uint32_t kPoints = TextureGroup::kPointsPerTexel;

/// Area that has no texel of its own where it lies.
struct Orphan {
  std::uint32_t chart = 0;
  std::uint32_t page = 0, x = 0, y = 0;
  bool any_owner = false;  ///< falls to the texel at (x, y) when its own chart is not near
  double area_m2 = 0;
};

struct Offset {
  int dx = 0, dy = 0;
};
/// The 5x5 neighbourhood, nearest first.
constexpr std::array<Offset, 25> make_offsets() {
  std::array<Offset, 25> o{};
  std::size_t n = 0;
  for (int d2 = 0; d2 <= 8; ++d2) {
    for (int dy = -2; dy <= 2; ++dy) {
      for (int dx = -2; dx <= 2; ++dx) {
        if (dx * dx + dy * dy == d2) o[n++] = {dx, dy};
      }
    }
  }
  return o;
}
constexpr auto kNearby = make_offsets();

/// Nearest point of a convex polygon.
Point closest_point(const Polygon& polygon, Point p) {
  Point best = polygon.v[0];
  double best_d2 = INFINITY;
  bool left = false, right = false;
  for (int i = 0; i < polygon.n; ++i) {
    const Point a = polygon.v[i], b = polygon.v[i + 1 < polygon.n ? i + 1 : 0];
    const double side = cross(a, b, p);
    (side >= 0 ? left : right) = true;
    const Point ab{b.x - a.x, b.y - a.y};
    const double l2 = ab.x * ab.x + ab.y * ab.y;
    const double dot = (p.x - a.x) * ab.x + (p.y - a.y) * ab.y;
    const double t = l2 > 0 ? std::clamp(dot / l2, 0.0, 1.0) : 0.0;
    const Point q{a.x + ab.x * t, a.y + ab.y * t};
    const double d2 = (p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y);
    if (d2 < best_d2) best_d2 = d2, best = q;
  }
  return left != right ? p : best;
}

/// Centroid of a polygon, times its area.
Point first_moment(const Polygon& p) {
  Point m;
  for (int i = 1; i + 1 < p.n; ++i) {
    const double a = std::abs(cross(p.v[0], p.v[i], p.v[i + 1])) / 2;
    m.x += a * (p.v[0].x + p.v[i].x + p.v[i + 1].x) / 3;
    m.y += a * (p.v[0].y + p.v[i].y + p.v[i + 1].y) / 3;
  }
  return m;
}

/// Mean over the points; evaluated once where it is constant on the points' triangle.
template <class Constant, class Value>
Rgb mean_over(SetupCache& setups, std::span<const SamplePoint> points, Constant constant,
              Value value) {
  Rgb sum, last;
  std::uint32_t last_triangle = 0xffffffffu;
  for (const SamplePoint& p : points) {
    if (p.triangle != last_triangle) {
      const std::optional<Rgb> same = constant(setups[p.triangle]);
      last = same ? *same : value(p);
      last_triangle = same ? p.triangle : 0xffffffffu;
    }
    sum += last;
  }
  return sum * (1.f / float(points.size()));
}

proto::Unexpected stopped() {
  return proto::fail(proto::kCanceledCode, "stopped while rasterising");
}

class Rasteriser {
 public:
  Rasteriser(const Scene& scene, const Atlas& atlas, std::stop_token stop)
      : scene_(scene), atlas_(atlas), stop_(std::move(stop)), setups_(scene, atlas) {}

  proto::Expected<TextureGroup> run(std::size_t max_pieces) {
    open_pages();
    reserve();
    BandSweep sweep(atlas_, max_pieces, stop_);
    for (std::uint32_t i = 0; i < atlas_.page_count * sweep.bands(); ++i) {
      if (stop_.stop_requested()) return stopped();
      if (!sweep.next()) {
        if (stop_.stop_requested()) return stopped();
        return proto::fail("limit_exceeded",
                           "too many triangles meet in eight rows of a lightmap page");
      }
      add_band(sweep);
    }
    for (const std::uint32_t t : sweep.flat_triangles()) add_flat(t);
    adopt_orphans();
    group_.front_count = group_.size();
    add_backs();
    if (stop_.stop_requested()) return stopped();
    return std::move(group_);
  }

 private:
  void open_pages() {
    const std::uint32_t size = atlas_.page_size;
    group_.pages.resize(atlas_.page_count);
    for (auto& page : group_.pages) {
      page.width = page.height = size;
      page.texel_at.assign(std::size_t(size) * size, -1);
    }
  }

  /// Room for the most texels there can be. What stays unused is never touched, so costs no memory.
  void reserve() {
    const double page = double(atlas_.page_size) * double(atlas_.page_size);
    double most = 0;
    bool two_sided = false;
    StopPoll poll(stop_);
    for (std::uint32_t t = 0; t < atlas_.triangles.size(); ++t) {
      if (poll()) return;
      const UvTriangle uv(atlas_, t);
      Interval xs, ys;
      for (const Point p : uv.p) xs.add(p.x), ys.add(p.y);
      const double width = xs.max - xs.min, height = ys.max - ys.min;
      most += uv.area() + 2 * (width + height) + 4;  // texels inside, and along the edges
      two_sided = two_sided || scene_.material_of(t).double_sided;
    }
    const double fronts = std::min(most, page * atlas_.page_count);
    const auto n = std::size_t(two_sided ? 2 * fronts : fronts);
    const auto room = [n](auto&... planes) { (planes.reserve(n), ...); };
    TextureGroup& g = group_;
    room(g.position, g.geometric_normal, g.shading_normal, g.albedo, g.emission, g.area_m2);
    room(g.coverage, g.triangle, g.chart, g.page, g.x, g.y, g.back);
    g.points.reserve(n * kPoints);
  }

  void add_band(const BandSweep& sweep) {
    const auto& all = sweep.fragments();
    StopPoll poll(stop_);
    for (std::size_t begin = 0, end = 0; begin < all.size() && !poll(); begin = end) {
      const std::uint32_t key = all[begin].key;
      while (end < all.size() && all[end].key == key) ++end;
      const std::uint32_t x = (key >> 6) * kBlock + (key & 7);
      const std::uint32_t y = sweep.band() * kBlock + (key >> 3 & 7);
      add_texel(sweep.page(), x, y, std::span(all).subspan(begin, end - begin));
    }
  }

  /// The chart that covers most of the texel keeps it; what others cover becomes orphans.
  std::uint32_t pick_chart(std::uint32_t page, std::uint32_t x, std::uint32_t y,
                           std::span<const Fragment> fragments) {
    by_chart_.clear();
    for (const Fragment& f : fragments) {
      by_chart_.push_back({atlas_.triangle_chart[f.triangle], f.triangle, f.area});
    }
    std::sort(by_chart_.begin(), by_chart_.end(), [](const ChartPiece& a, const ChartPiece& b) {
      return a.chart != b.chart ? a.chart < b.chart : a.triangle < b.triangle;
    });
    double best = -1;
    std::uint32_t winner = 0;
    for (std::size_t i = 0; i < by_chart_.size();) {
      const std::uint32_t chart = by_chart_[i].chart;
      double sum = 0;
      for (; i < by_chart_.size() && by_chart_[i].chart == chart; ++i) sum += by_chart_[i].area;
      if (sum > best) best = sum, winner = chart;
    }
    for (const ChartPiece& p : by_chart_) {
      if (p.chart == winner) continue;
      orphans_.push_back({p.chart, page, x, y, true, p.area * setups_[p.triangle].m2_per_texel2});
    }
    return winner;
  }

  void add_texel(std::uint32_t page, std::uint32_t x, std::uint32_t y,
                 std::span<const Fragment> fragments) {
    std::uint32_t chart = atlas_.triangle_chart[fragments.front().triangle];
    const bool shared = std::any_of(fragments.begin(), fragments.end(), [&](const Fragment& f) {
      return atlas_.triangle_chart[f.triangle] != chart;
    });
    if (shared) chart = pick_chart(page, x, y, fragments);
    pieces_.clear();
    for (const Fragment& f : fragments) {
      if (atlas_.triangle_chart[f.triangle] == chart) pieces_.push_back({f.triangle, f.area});
    }
    group_.pages[page].texel_at[std::size_t(y) * atlas_.page_size + x] = std::int32_t(size());
    group_.chart.push_back(chart);
    group_.page.push_back(std::uint16_t(page));
    group_.x.push_back(std::uint16_t(x));
    group_.y.push_back(std::uint16_t(y));
    group_.back.push_back(-1);
    add_surface(x, y);
    add_points(page, x, y);
  }

  /// Area, coverage, and the representative point: on the triangle that covers most, as near to the
  /// footprint's centroid as that goes.
  void add_surface(std::uint32_t x, std::uint32_t y) {
    double area = 0, covered = 0;
    Piece most;
    Point moment;
    for (const Piece& p : pieces_) {
      area += p.area * setups_[p.triangle].m2_per_texel2;
      covered += p.area;
      if (p.area > most.area || (p.area == most.area && p.triangle < most.triangle)) most = p;
      if (pieces_.size() == 1 && p.area == 1) continue;
      const Point m = first_moment(clip_to_texel(setups_[p.triangle].polygon(), x, y));
      moment.x += m.x, moment.y += m.y;
    }
    const TriangleSetup& setup = setups_[most.triangle];
    Point at{double(x) + 0.5, double(y) + 0.5};
    if (most.area < 1) {
      const Point centroid{moment.x / covered, moment.y / covered};
      const Polygon footprint = clip_to_texel(setup.polygon(), x, y);
      at = footprint.n >= 3 ? closest_point(footprint, centroid) : centroid;
    }
    const Bary bary = make_point(most.triangle, setup.bary(at)).bary();
    group_.position.push_back(position_at(scene_, most.triangle, bary));
    group_.geometric_normal.push_back(setup.normal);
    group_.shading_normal.push_back(shading_normal(scene_, most.triangle, bary));
    group_.area_m2.push_back(float(area));
    group_.coverage.push_back(float(std::min(covered, 1.0)));
    group_.triangle.push_back(most.triangle);
  }

  void add_points(std::uint32_t page, std::uint32_t x, std::uint32_t y) {
    const std::size_t first = group_.points.size();
    group_.points.resize(first + kPoints);
    const std::span<SamplePoint> points(group_.points.data() + first, kPoints);
    place_points(setups_, page, x, y, pieces_, points);
    const Rgb albedo = mean_over(
        setups_, points,
        [](const TriangleSetup& t) {
          return t.constant_albedo ? std::optional(t.albedo) : std::nullopt;
        },
        [&](const SamplePoint& p) { return albedo_at(scene_, p.triangle, p.bary()); });
    const Rgb emission = mean_over(
        setups_, points,
        [](const TriangleSetup& t) {
          return t.constant_emission ? std::optional(t.emission) : std::nullopt;
        },
        [&](const SamplePoint& p) { return emission_at(scene_, p.triangle, p.bary()); });
    const Rgb capped{std::min(albedo.r, kMaxAlbedo), std::min(albedo.g, kMaxAlbedo),
                     std::min(albedo.b, kMaxAlbedo)};
    if (capped != albedo) ++group_.albedo_capped;
    group_.albedo.push_back(capped);
    group_.emission.push_back(emission);
  }

  void add_flat(std::uint32_t triangle) {
    const UvTriangle uv(atlas_, triangle);
    const double last = double(atlas_.page_size) - 1;
    const auto clamp = [&](double v) {
      return std::uint32_t(std::clamp(std::floor(v), 0.0, last));
    };
    orphans_.push_back({atlas_.triangle_chart[triangle], atlas_.page_of(triangle),
                        clamp((uv.p[0].x + uv.p[1].x + uv.p[2].x) / 3),
                        clamp((uv.p[0].y + uv.p[1].y + uv.p[2].y) / 3), false,
                        double(triangle_area(scene_, triangle))});
  }

  void adopt_orphans() {
    const int size = int(atlas_.page_size);
    StopPoll poll(stop_);
    for (const Orphan& o : orphans_) {
      if (poll()) return;
      const auto& texel_at = group_.pages[o.page].texel_at;
      std::int32_t heir = o.any_owner ? texel_at[std::size_t(o.y) * atlas_.page_size + o.x] : -1;
      for (const Offset d : kNearby) {
        const int x = int(o.x) + d.dx, y = int(o.y) + d.dy;
        if (x < 0 || y < 0 || x >= size || y >= size) continue;
        const std::int32_t t = texel_at[std::size_t(y) * atlas_.page_size + std::size_t(x)];
        if (t < 0 || group_.chart[std::size_t(t)] != o.chart) continue;
        heir = t;
        break;
      }
      if (heir >= 0) group_.area_m2[std::size_t(heir)] += float(o.area_m2);
    }
  }

  void add_backs() {
    StopPoll poll(stop_);
    for (std::uint32_t t = 0; t < group_.front_count; ++t) {
      if (poll()) return;
      if (!scene_.material_of(group_.triangle[t]).double_sided) continue;
      group_.back[t] = std::int32_t(size());
      group_.back.push_back(-1);
      const auto again = [t](auto& plane) { plane.push_back(plane[t]); };
      again(group_.position), again(group_.albedo), again(group_.emission);
      again(group_.area_m2), again(group_.coverage), again(group_.triangle);
      again(group_.chart), again(group_.page), again(group_.x), again(group_.y);
      group_.geometric_normal.push_back(-group_.geometric_normal[t]);
      group_.shading_normal.push_back(-group_.shading_normal[t]);
      for (std::uint32_t i = 0; i < kPoints; ++i) {
        group_.points.push_back(group_.points[std::size_t(t) * kPoints + i]);
      }
    }
  }

  std::uint32_t size() const { return group_.size(); }

  struct ChartPiece {
    std::uint32_t chart = 0, triangle = 0;
    double area = 0;
  };
  const Scene& scene_;
  const Atlas& atlas_;
  std::stop_token stop_;
  SetupCache setups_;
  TextureGroup group_;
  std::vector<Orphan> orphans_;
  std::vector<Piece> pieces_;         // of the texel at hand
  std::vector<ChartPiece> by_chart_;  // likewise
};

}  // namespace

proto::Expected<TextureGroup> rasterise(const Scene& scene, const Atlas& atlas,
                                        std::stop_token stop, std::size_t max_pieces) {
  return Rasteriser(scene, atlas, std::move(stop)).run(max_pieces);
}

}  // namespace kiln::baker
