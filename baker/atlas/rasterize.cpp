#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>

#include "baker/atlas/band_sweep.h"
#include "baker/atlas/texel_filler.h"
#include "baker/atlas/texture_group.h"
#include "baker/exec/stop.h"
#include "baker/exec/thread_pool.h"

namespace kiln::atlas {
namespace {
constexpr std::uint32_t kPoints = TextureGroup::kPointsPerTexel;
constexpr std::uint32_t kTexelsPerBatch = 1024;
/// The number of fragments that may wait for fill_texels(): enough for many batches, at 16 bytes
/// each.
constexpr std::size_t kWaitingFragments = std::size_t(1) << 18;

/// An area of surface that has no texel of its own at its place on the page.
struct StrayArea {
  std::uint32_t chart = 0;
  std::uint32_t page = 0, x = 0, y = 0;
  bool any_owner = false;  ///< the texel at (x, y) takes it when its own chart is not near
  double area_m2 = 0;
};

struct Offset {
  int dx = 0, dy = 0;
};
/// Returns the 5x5 neighborhood, nearest first.
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

/// Lends each running batch a filler, and lends it again to later batches.
class FillerPool {
 public:
  FillerPool(const scene::Scene& scene, const Atlas& atlas) : scene_(scene), atlas_(atlas) {}

  std::unique_ptr<TexelFiller> take() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) return std::make_unique<TexelFiller>(scene_, atlas_);
    auto filler = std::move(idle_.back());
    idle_.pop_back();
    return filler;
  }
  void put(std::unique_ptr<TexelFiller> filler) {
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(filler));
  }

 private:
  const scene::Scene& scene_;
  const Atlas& atlas_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<TexelFiller>> idle_;  // guarded by mutex_
};

/// Finds the texels of all charts in one sweep, with the fragments of triangles that each texel
/// owns. The surface of a texel is then computed from its fragments, for many texels at a time.
class Rasterizer {
 public:
  Rasterizer(const scene::Scene& scene, const Atlas& atlas, std::stop_token stop,
             exec::ThreadPool* pool)
      : scene_(scene),
        atlas_(atlas),
        stop_(std::move(stop)),
        pool_(pool),
        fillers_(scene, atlas),
        setups_(scene, atlas) {}

  proto::Expected<TextureGroup> run(std::size_t max_fragments) {
    open_pages();
    reserve();
    BandSweep sweep(atlas_, max_fragments, stop_);
    for (std::uint32_t i = 0; i < atlas_.page_count * sweep.bands(); ++i) {
      if (stop_.stop_requested()) return exec::canceled();
      if (!sweep.next()) {
        if (stop_.stop_requested()) return exec::canceled();
        return proto::fail("limit_exceeded",
                           "Too many triangles meet in eight rows of a lightmap page.");
      }
      add_band(sweep);
      if (fragments_.size() >= kWaitingFragments && !fill_texels()) return exec::canceled();
    }
    if (!fill_texels()) return exec::canceled();
    for (const std::uint32_t t : sweep.flat_triangles()) add_flat(t);
    assign_stray_areas();
    group_.front_count = group_.size();
    add_backs();
    if (stop_.stop_requested()) return exec::canceled();
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

  /// Reserves room for the most texels that there can be. Room that stays unused is never touched,
  /// so it costs no memory.
  void reserve() {
    const double page = double(atlas_.page_size) * double(atlas_.page_size);
    double most = 0;
    bool two_sided = false;
    exec::StopPoll poll(stop_);
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
    room(g.position, g.shading_normal, g.albedo, g.area_m2);
    room(g.coverage, g.triangle, g.chart, g.page, g.x, g.y, g.back);
    g.points.reserve(n * kPoints);
  }

  void add_band(const BandSweep& sweep) {
    const auto& all = sweep.fragments();
    exec::StopPoll poll(stop_);
    for (std::size_t begin = 0, end = 0; begin < all.size() && !poll(); begin = end) {
      const std::uint32_t key = all[begin].key;
      while (end < all.size() && all[end].key == key) ++end;
      const std::uint32_t x = (key >> 6) * kBlock + (key & 7);
      const std::uint32_t y = sweep.band() * kBlock + (key >> 3 & 7);
      add_texel(sweep.page(), x, y, std::span(all).subspan(begin, end - begin));
    }
  }

  /// Returns the chart that covers most of the texel and so keeps it. The area that other charts
  /// cover becomes stray.
  std::uint32_t pick_chart(std::uint32_t page, std::uint32_t x, std::uint32_t y,
                           std::span<const Fragment> fragments) {
    by_chart_.clear();
    for (const Fragment& f : fragments) {
      by_chart_.push_back({atlas_.triangle_chart[f.triangle], f.triangle, f.area});
    }
    std::sort(by_chart_.begin(), by_chart_.end(),
              [](const ChartFragment& a, const ChartFragment& b) {
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
    for (const ChartFragment& f : by_chart_) {
      if (f.chart == winner) continue;
      stray_areas_.push_back(
          {f.chart, page, x, y, true, f.area * setups_[f.triangle].m2_per_texel2});
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
    for (const Fragment& f : fragments) {
      if (atlas_.triangle_chart[f.triangle] == chart) fragments_.push_back(f);
    }
    group_.pages[page].texel_at[std::size_t(y) * atlas_.page_size + x] =
        std::int32_t(group_.chart.size());
    group_.chart.push_back(chart);
    group_.page.push_back(std::uint16_t(page));
    group_.x.push_back(std::uint16_t(x));
    group_.y.push_back(std::uint16_t(y));
    group_.back.push_back(-1);
    fragment_ends_.push_back(fragments_.size());
  }

  /// Computes the surface of the texels that were found since the last call. Returns false when
  /// stopped.
  bool fill_texels() {
    const auto begin = std::uint32_t(size()), end = std::uint32_t(group_.chart.size());
    const auto resize = [end](auto&... planes) { (planes.resize(end), ...); };
    TextureGroup& g = group_;
    resize(g.position, g.shading_normal, g.albedo, g.area_m2);
    resize(g.coverage, g.triangle);
    g.points.resize(std::size_t(end) * kPoints);
    std::atomic<std::uint64_t> capped{0};
    const auto batch = [&](std::uint32_t b) {
      auto filler = fillers_.take();
      const std::uint32_t first = b * kTexelsPerBatch;
      const std::uint32_t last = std::min(first + kTexelsPerBatch, end - begin);
      std::uint64_t count = 0;
      for (std::uint32_t i = first; i < last && !stop_.stop_requested(); ++i) {
        const std::size_t from = i == 0 ? 0 : fragment_ends_[i - 1];
        const auto fragments = std::span(fragments_).subspan(from, fragment_ends_[i] - from);
        count += filler->fill(group_, begin + i, fragments);
      }
      capped += count;
      fillers_.put(std::move(filler));
    };
    const std::uint32_t batches = (end - begin + kTexelsPerBatch - 1) / kTexelsPerBatch;
    if (!run_batches(batches, batch)) return false;
    group_.albedo_capped += capped;
    fragments_.clear();
    fragment_ends_.clear();
    return true;
  }

  bool run_batches(std::uint32_t count, const std::function<void(std::uint32_t)>& batch) {
    if (pool_) return pool_->for_batches(count, stop_, batch);
    for (std::uint32_t b = 0; b < count; ++b) {
      if (stop_.stop_requested()) return false;
      batch(b);
    }
    return true;
  }

  void add_flat(std::uint32_t triangle) {
    const UvTriangle uv(atlas_, triangle);
    const double last = double(atlas_.page_size) - 1;
    const auto clamp = [&](double v) {
      return std::uint32_t(std::clamp(std::floor(v), 0.0, last));
    };
    stray_areas_.push_back({atlas_.triangle_chart[triangle], atlas_.page_of(triangle),
                            clamp((uv.p[0].x + uv.p[1].x + uv.p[2].x) / 3),
                            clamp((uv.p[0].y + uv.p[1].y + uv.p[2].y) / 3), false,
                            double(triangle_area(scene_, triangle))});
  }

  void assign_stray_areas() {
    const int size = int(atlas_.page_size);
    exec::StopPoll poll(stop_);
    for (const StrayArea& a : stray_areas_) {
      if (poll()) return;
      const auto& texel_at = group_.pages[a.page].texel_at;
      std::int32_t recipient =
          a.any_owner ? texel_at[std::size_t(a.y) * atlas_.page_size + a.x] : -1;
      for (const Offset d : kNearby) {
        const int x = int(a.x) + d.dx, y = int(a.y) + d.dy;
        if (x < 0 || y < 0 || x >= size || y >= size) continue;
        const std::int32_t t = texel_at[std::size_t(y) * atlas_.page_size + std::size_t(x)];
        if (t < 0 || group_.chart[std::size_t(t)] != a.chart) continue;
        recipient = t;
        break;
      }
      if (recipient >= 0) group_.area_m2[std::size_t(recipient)] += float(a.area_m2);
    }
  }

  void add_backs() {
    exec::StopPoll poll(stop_);
    for (std::uint32_t t = 0; t < group_.front_count; ++t) {
      if (poll()) return;
      if (!scene_.material_of(group_.triangle[t]).double_sided) continue;
      group_.back[t] = std::int32_t(size());
      group_.back.push_back(-1);
      const auto again = [t](auto& plane) { plane.push_back(plane[t]); };
      again(group_.position), again(group_.albedo);
      again(group_.area_m2), again(group_.coverage), again(group_.triangle);
      again(group_.chart), again(group_.page), again(group_.x), again(group_.y);
      group_.shading_normal.push_back(-group_.shading_normal[t]);
      for (std::uint32_t i = 0; i < kPoints; ++i) {
        group_.points.push_back(group_.points[std::size_t(t) * kPoints + i]);
      }
    }
  }

  std::uint32_t size() const { return group_.size(); }

  struct ChartFragment {
    std::uint32_t chart = 0, triangle = 0;
    double area = 0;
  };
  const scene::Scene& scene_;
  const Atlas& atlas_;
  std::stop_token stop_;
  exec::ThreadPool* pool_;
  FillerPool fillers_;
  SetupCache setups_;
  TextureGroup group_;
  std::vector<StrayArea> stray_areas_;
  std::vector<Fragment> fragments_;         // fragments of the texels that wait for fill_texels()
  std::vector<std::size_t> fragment_ends_;  // one per such texel
  std::vector<ChartFragment> by_chart_;     // fragments of the texel at hand
};

}  // namespace

proto::Expected<TextureGroup> rasterize(const scene::Scene& scene, const Atlas& atlas,
                                        std::stop_token stop, std::size_t max_fragments,
                                        exec::ThreadPool* pool) {
  return Rasterizer(scene, atlas, std::move(stop), pool).run(max_fragments);
}

}  // namespace kiln::atlas
