#include "baker/atlas/atlas.h"

#include <algorithm>
#include <bit>
#include <functional>
#include <numeric>
#include <tuple>

#include "baker/atlas/layout.h"
#include "baker/atlas/source_uv.h"
#include "baker/atlas/unwrap.h"
#include "baker/exec/stop.h"

namespace kiln::atlas {
namespace {
/// Returns the error for `unwrap: existing`, with a detail for each of the first primitives that
/// are not valid.
proto::Unexpected refuse(const scene::Scene& scene, std::span<const SourceUv> source) {
  constexpr std::size_t kMaxDetails = 32;
  proto::Error error{"invalid_lightmap_uv",
                     "atlas.unwrap is \"existing\", but TEXCOORD_1 cannot hold a lightmap",
                     {}};
  for (std::size_t i = 0; i < source.size() && error.details.size() < kMaxDetails; ++i) {
    const scene::Instance& instance = scene.instances[i];
    if (source[i].valid || instance.part_count == 0) continue;
    const std::string pointer = "/meshes/" + std::to_string(instance.mesh) + "/primitives/" +
                                std::to_string(scene.parts[source[i].part].primitive) +
                                "/attributes/TEXCOORD_1";
    const bool known = std::any_of(error.details.begin(), error.details.end(),
                                   [&](const auto& d) { return d.pointer == pointer; });
    if (!known) error.details.push_back({"scene", pointer, source[i].reason});
  }
  return proto::Unexpected(std::move(error));
}

/// Returns the side of a texel, m: at the settings' density, or as if the surface filled one page
/// to the brim.
double least_texel(const scene::Scene& scene, const proto::AtlasSettings& settings) {
  if (settings.texels_per_metre) return 1 / double(*settings.texels_per_metre);
  double area = 0;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    area += double(triangle_area(scene, t));
  }
  return std::sqrt(area) / settings.page_size;
}

class AtlasBuilder {
 public:
  AtlasBuilder(const scene::Scene& scene, const proto::AtlasSettings& settings,
               std::stop_token stop)
      : scene_(scene),
        settings_(settings),
        stop_(std::move(stop)),
        unwrapper_(least_texel(scene, settings)) {}

  proto::Expected<Atlas> build() {
    atlas_.page_size = settings_.page_size;
    atlas_.triangles.resize(scene_.triangles.size());
    atlas_.triangle_chart.resize(scene_.triangles.size());
    atlas_.placements.resize(scene_.instances.size());
    if (!check_source()) return exec::canceled();
    if (settings_.unwrap == proto::Unwrap::kExisting && kept_.size() < drawn_) {
      return refuse(scene_, source_);
    }
    shared_ = !kept_.empty() && share_one_page(scene_, kept_, settings_.page_size, stop_);
    for (std::uint32_t i = 0; i < scene_.instances.size(); ++i) {
      if (stop_.stop_requested()) return exec::canceled();
      atlas_.placements[i].uses_source_uv = keeps(i);
      if (scene_.instances[i].part_count == 0) continue;
      keeps(i) ? add_source(i) : add_unwrapped(i);
    }
    if (stop_.stop_requested() || !sort_vertices()) return exec::canceled();
    if (auto placed = place(); !placed) return proto::Unexpected(placed.error());
    if (!finish()) return exec::canceled();
    return std::move(atlas_);
  }

  /// Finds what would make build() succeed. It may be called once build() has given `atlas_full`.
  LayoutAdvice advice() const { return find_layout_advice(blocks_, settings_, stop_); }

 private:
  bool keeps(std::uint32_t instance) const { return !source_.empty() && source_[instance].valid; }

  /// Fills source_ and kept_. Returns false when stopped.
  bool check_source() {
    for (const scene::Instance& instance : scene_.instances) drawn_ += instance.part_count > 0;
    if (settings_.unwrap == proto::Unwrap::kAlways) {
      for (auto& p : atlas_.placements) p.reason = "atlas.unwrap is \"always\"";
      return true;
    }
    source_ = check_source_uv(scene_, settings_.page_size, stop_);
    if (stop_.stop_requested()) return false;
    for (std::uint32_t i = 0; i < source_.size(); ++i) {
      atlas_.placements[i].reason = source_[i].reason;
      if (source_[i].valid) kept_.push_back(i);
    }
    return true;
  }

  // 1. Collect charts, blocks and corners. Until place(), a vertex has no uv, and vertex_chart_
  // names its chart.

  struct ChartVertex {
    std::uint32_t part = 0, vertex = 0, chart = 0;
    std::uint32_t triangle = 0, corner = 0;
    auto key() const { return std::tie(part, vertex, chart); }
  };

  void add_triangle(std::uint32_t t, std::uint32_t chart) {
    atlas_.triangle_chart[t] = chart;
    for (std::uint32_t k = 0; k < 3; ++k) {
      corners_.push_back({scene_.triangle_part[t], scene_.triangles[t][k], chart, t, k});
    }
  }

  std::uint32_t first_new_chart() const { return std::uint32_t(atlas_.charts.size()); }

  /// Adds an instance that keeps its TEXCOORD_1. All its charts move as one block; when the
  /// instances share a page, all instances move as one.
  void add_source(std::uint32_t i) {
    const Surface surface = weld(scene_, scene_.instances[i], WeldBy::kPositionAndUv, stop_);
    if (stop_.stop_requested()) return;
    std::uint32_t count = 0;
    const auto piece = connected_pieces(surface, &count, stop_);
    if (stop_.stop_requested()) return;
    const std::uint32_t first = first_new_chart();
    if (!shared_ || shared_block_ == kNoBlock) open_source_block(i);
    const std::uint32_t block = shared_ ? shared_block_ : std::uint32_t(blocks_.size() - 1);
    for (std::uint32_t c = 0; c < count; ++c) add_chart(i, block);
    for (std::size_t k = 0; k < piece.size(); ++k) {
      add_triangle(surface.triangles[k], first + piece[k]);
    }
  }

  void open_source_block(std::uint32_t i) {
    math::Vec2 min{1, 1}, max{0, 0};
    double uv_area = 0, world_area = 0;
    const auto join = [&](const SourceUv& s) {
      min = {std::min(min.x, s.min.x), std::min(min.y, s.min.y)};
      max = {std::max(max.x, s.max.x), std::max(max.y, s.max.y)};
      uv_area += s.uv_area, world_area += s.world_area;
    };
    if (shared_) {
      for (const std::uint32_t k : kept_) join(source_[k]);
      shared_block_ = std::uint32_t(blocks_.size());
    } else {
      join(source_[i]);
    }
    const double meters_per_uv = std::sqrt(world_area / uv_area);
    open_block((double(max.x) - double(min.x)) * meters_per_uv,
               (double(max.y) - double(min.y)) * meters_per_uv);
    block_origin_.back() = {min.x, min.y};
    block_extent_.back() = {double(max.x) - double(min.x), double(max.y) - double(min.y)};
  }

  void add_unwrapped(std::uint32_t i) {
    const Unwrapped u = unwrapper_.unwrap(scene_, scene_.instances[i], stop_);
    const std::uint32_t first = first_new_chart();
    ++groups_;
    for (const ChartFrame& frame : u.frames) {
      blocks_.push_back({groups_, frame.width, frame.height});
      block_origin_.push_back({});
      block_extent_.push_back({frame.width, frame.height});
      add_chart(i, std::uint32_t(blocks_.size() - 1));
      frames_.resize(atlas_.charts.size());
      frames_.back() = frame;
    }
    for (std::size_t k = 0; k < u.triangles.size(); ++k) {
      add_triangle(u.triangles[k], first + u.chart[k]);
    }
  }

  void open_block(double width, double height) {
    blocks_.push_back({++groups_, width, height});
    block_origin_.emplace_back();
    block_extent_.emplace_back();
  }

  void add_chart(std::uint32_t instance, std::uint32_t block) {
    atlas_.charts.push_back({instance, 0, {}, {}});
    chart_block_.push_back(block);
  }

  /// Makes one vertex for each combination of part, scene vertex and chart, in that order. Returns
  /// false when stopped.
  bool sort_vertices() {
    const auto before = [](const ChartVertex& a, const ChartVertex& b) {
      return a.key() != b.key() ? a.key() < b.key()
                                : std::tie(a.triangle, a.corner) < std::tie(b.triangle, b.corner);
    };
    if (!exec::sort_unless_stopped(corners_, before, stop_)) return false;
    atlas_.part_first_vertex.assign(scene_.parts.size() + 1, 0);
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const ChartVertex& c = corners_[i];
      if (i == 0 || c.key() != corners_[i - 1].key()) {
        atlas_.vertices.push_back({c.vertex, {}});
        vertex_chart_.push_back(c.chart);
        atlas_.part_first_vertex[c.part + 1] = std::uint32_t(atlas_.vertices.size());
      }
      atlas_.triangles[c.triangle][c.corner] = std::uint32_t(atlas_.vertices.size() - 1);
    }
    auto& first = atlas_.part_first_vertex;
    for (std::size_t i = 1; i < first.size(); ++i) first[i] = std::max(first[i], first[i - 1]);
    corners_ = {};
    return true;
  }

  // 2. Place the blocks on pages and the vertices in their blocks.

  proto::Expected<void> place() {
    if (shared_ && kept_.size() == drawn_) {
      place_as_is();
      return {};
    }
    const auto layout = lay_out_blocks(blocks_, settings_, stop_);
    if (!layout) return proto::Unexpected(layout.error());
    atlas_.page_count = layout->pages;
    for (std::size_t i = 0; i < atlas_.vertices.size(); ++i) place_vertex(i, *layout);
    for (std::size_t c = 0; c < atlas_.charts.size(); ++c) {
      atlas_.charts[c].page = layout->places[chart_block_[c]].page;
      record_placement(c, *layout);
    }
    return {};
  }

  /// Uses the one scene-wide layout as it is.
  void place_as_is() {
    const float side = float(settings_.page_size);
    atlas_.page_count = 1;
    for (AtlasVertex& v : atlas_.vertices) {
      const math::Vec2 uv = scene_.lightmap_uv[v.scene_vertex];
      v.uv = {std::clamp(uv.x, 0.f, 1.f) * side, std::clamp(uv.y, 0.f, 1.f) * side};
    }
  }

  void place_vertex(std::size_t i, const Layout& layout) {
    AtlasVertex& v = atlas_.vertices[i];
    const std::uint32_t chart = vertex_chart_[i], block = chart_block_[chart];
    const Place& place = layout.places[block];
    Point p;
    if (keeps(atlas_.charts[chart].instance)) {
      const math::Vec2 uv = scene_.lightmap_uv[v.scene_vertex];
      p = {double(uv.x) - block_origin_[block].x, double(uv.y) - block_origin_[block].y};
    } else {
      p = frames_[chart].project(scene_.positions[v.scene_vertex]);
    }
    // Rounding must not carry a vertex over the block's edge: it would touch one more texel.
    const auto fit = [](double at, double extent, std::uint32_t size) {
      return extent > 0 ? std::clamp(at / extent, 0.0, 1.0) * size : 0.0;
    };
    v.uv = {float(place.x + fit(p.x, block_extent_[block].x, place.width)),
            float(place.y + fit(p.y, block_extent_[block].y, place.height))};
  }

  void record_placement(std::size_t chart, const Layout& layout) {
    const std::uint32_t instance = atlas_.charts[chart].instance, block = chart_block_[chart];
    const Place& place = layout.places[block];
    InstancePlacement& out = atlas_.placements[instance];
    out.page = place.page;
    if (!out.uses_source_uv) return;
    const double side = double(settings_.page_size);
    const Point origin = block_origin_[block], extent = block_extent_[block];
    out.scale = {float(place.width / extent.x / side), float(place.height / extent.y / side)};
    out.offset = {float((place.x - origin.x * place.width / extent.x) / side),
                  float((place.y - origin.y * place.height / extent.y) / side)};
  }

  /// Sets the charts' bounds and the atlas's density. Returns false when stopped.
  bool finish() {
    for (Chart& chart : atlas_.charts) {
      chart.min = {INFINITY, INFINITY};
      chart.max = {-INFINITY, -INFINITY};
    }
    std::vector<std::pair<double, double>> density;  // texels per meter, m2
    density.reserve(atlas_.triangles.size());
    double total = 0;
    for (std::uint32_t t = 0; t < atlas_.triangles.size(); ++t) {
      Chart& chart = atlas_.charts[atlas_.triangle_chart[t]];
      for (const std::uint32_t v : atlas_.triangles[t]) {
        const math::Vec2 uv = atlas_.vertices[v].uv;
        chart.min = {std::min(chart.min.x, uv.x), std::min(chart.min.y, uv.y)};
        chart.max = {std::max(chart.max.x, uv.x), std::max(chart.max.y, uv.y)};
      }
      const double area = double(triangle_area(scene_, t));
      density.emplace_back(std::sqrt(UvTriangle(atlas_, t).area() / area), area);
      total += area;
    }
    if (!exec::sort_unless_stopped(density, std::less<>(), stop_)) return false;
    double below = 0;
    for (const auto& [value, area] : density) {
      below += area;
      if (below < total / 2) continue;
      atlas_.texels_per_metre = float(value);
      break;
    }
    return true;
  }

  static constexpr std::uint32_t kNoBlock = 0xffffffffu;

  const scene::Scene& scene_;
  const proto::AtlasSettings& settings_;
  std::stop_token stop_;
  Atlas atlas_;
  Unwrapper unwrapper_;
  std::vector<SourceUv> source_;     ///< per instance; empty when source layouts are ignored
  std::vector<std::uint32_t> kept_;  ///< instances whose layout is used
  std::size_t drawn_ = 0;            ///< instances that have triangles
  bool shared_ = false;              ///< the kept ones share one page
  std::uint32_t shared_block_ = kNoBlock;
  std::uint32_t groups_ = 0;
  std::vector<Block> blocks_;
  std::vector<Point> block_origin_, block_extent_;  ///< in UV for source layouts, m for charts
  std::vector<std::uint32_t> chart_block_;
  std::vector<ChartFrame> frames_;  ///< per chart; unused for source layouts
  std::vector<ChartVertex> corners_;
  std::vector<std::uint32_t> vertex_chart_;
};

bool is_full(const proto::Expected<Atlas>& atlas) {
  return !atlas && atlas.error().code == "atlas_full";
}

/// Returns the least page size that is large enough, doubling from `first` on, or 0 when none of
/// the few that it tries is. The size of a texel decides how charts are cut, so each try unwraps
/// the scene.
std::uint32_t find_page_size(const scene::Scene& scene, proto::AtlasSettings settings,
                             std::uint32_t first, const std::stop_token& stop) {
  constexpr std::uint32_t kMost = proto::AtlasSettings::kMostPageSize, kTrials = 3;
  std::uint32_t size = first;
  for (std::uint32_t i = 0; i < kTrials && size > 0 && size <= kMost; ++i, size *= 2) {
    settings.page_size = size;
    if (!is_full(AtlasBuilder(scene, settings, stop).build())) return size;
  }
  return 0;
}

/// Returns the end of the error's message: "; atlas.page_size 512 or atlas.max_pages 12 would do".
std::string advice_text(const scene::Scene& scene, proto::AtlasSettings settings,
                        LayoutAdvice advice, const std::stop_token& stop) {
  advice.page_size = find_page_size(scene, settings, advice.page_size, stop);
  std::string text;
  if (advice.page_size == 0 && advice.max_pages == 0 && settings.texels_per_metre) {
    settings.texels_per_metre.reset();
    advice.page_size = find_page_size(scene, settings, std::bit_ceil(settings.page_size), stop);
    text = "without atlas.texels_per_metre, ";
  }
  const std::string pages = "atlas.max_pages " + std::to_string(advice.max_pages),
                    size = "atlas.page_size " + std::to_string(advice.page_size);
  if (advice.page_size > 0 && advice.max_pages > 0)
    return "; " + size + " or " + pages + " would do";
  if (advice.page_size > 0) return "; " + text + size + " would do";
  if (advice.max_pages > 0) return "; " + pages + " would do";
  return settings.gutter > 0 ? "; a smaller atlas.gutter may help" : "";
}

}  // namespace

proto::Expected<Atlas> build_atlas(const scene::Scene& scene, const proto::AtlasSettings& settings,
                                   std::stop_token stop) {
  LayoutAdvice advice;
  auto atlas = [&] {
    AtlasBuilder builder(scene, settings, stop);
    auto built = builder.build();
    if (is_full(built)) advice = builder.advice();
    return built;
  }();
  if (!is_full(atlas)) return atlas;
  proto::Error error = atlas.error();
  error.message += advice_text(scene, settings, advice, stop);
  if (stop.stop_requested()) return exec::canceled();
  for (auto& place : error.details) place.detail = error.message;
  return proto::Unexpected(std::move(error));
}

}  // namespace kiln::atlas
