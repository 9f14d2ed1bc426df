#include "baker/atlas/source_uv.h"

#include <cstdio>
#include <map>

#include "baker/atlas/overlap_grid.h"
#include "baker/atlas/weld.h"

namespace kiln::atlas {
namespace {

constexpr float kOutside = 1e-4f;  ///< exporters round so far beyond [0, 1]; it is clamped
/// A face laid out at less than a thousandth of its mesh's density counts as having no area.
constexpr double kThin = 1e-6;
/// The share of a surface without area in UV, and of a piece that is folded back, that counts as
/// rounding.
constexpr double kTolerated = 1e-3;
/// The share of covered samples that shared edges may claim twice.
constexpr double kShallow = 0.01;
constexpr std::uint64_t kCellBudget = std::uint64_t(1) << 26;  ///< cells of all layouts together

double uv_area(const scene::Scene& scene, std::uint32_t triangle) {
  const auto& v = scene.triangles[triangle];
  const math::Vec2 a = scene.lightmap_uv[v[0]], b = scene.lightmap_uv[v[1]],
                   c = scene.lightmap_uv[v[2]];
  return cross(Point{a.x, a.y}, Point{b.x, b.y}, Point{c.x, c.y}) / 2;  // signed
}

/// Calls visit(triangle) for the triangles of an instance until it returns false.
template <class Visit>
bool all_triangles(const scene::Scene& scene, const scene::Instance& instance, Visit&& visit) {
  for (std::uint32_t k = 0; k < instance.part_count; ++k) {
    const scene::Part& part = scene.parts[instance.first_part + k];
    for (std::uint32_t i = 0; i < part.triangle_count; ++i) {
      if (!visit(part.first_triangle + i)) return false;
    }
  }
  return true;
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g %%", share * 100);
  return text;
}

SourceUv invalid(std::uint32_t part, std::string reason) {
  SourceUv v;
  v.part = part;
  v.reason = std::move(reason);
  return v;
}

/// Checks that TEXCOORD_1 is there and within range, and fills the bounds.
SourceUv check_range(const scene::Scene& scene, const scene::Instance& instance) {
  if (instance.part_count == 0) return {};
  SourceUv result;
  result.min = {1, 1}, result.max = {0, 0};
  for (std::uint32_t k = 0; k < instance.part_count; ++k) {
    const std::uint32_t p = instance.first_part + k;
    const scene::Part& part = scene.parts[p];
    if (!part.has_lightmap_uv) {
      return invalid(p, "primitive " + std::to_string(part.primitive) + " has no TEXCOORD_1");
    }
    for (std::uint32_t i = 0; i < part.triangle_count; ++i) {
      for (const std::uint32_t v : scene.triangles[part.first_triangle + i]) {
        const math::Vec2 uv = scene.lightmap_uv[v];
        if (!std::isfinite(uv.x) || !std::isfinite(uv.y)) {
          return invalid(p, "TEXCOORD_1 holds a value that is not finite");
        }
        if (std::min(uv.x, uv.y) < -kOutside || std::max(uv.x, uv.y) > 1 + kOutside) {
          char text[96];
          std::snprintf(text, sizeof text, "TEXCOORD_1 leaves [0, 1]: (%.6g, %.6g)", double(uv.x),
                        double(uv.y));
          return invalid(p, text);
        }
        result.min = {std::min(result.min.x, uv.x), std::min(result.min.y, uv.y)};
        result.max = {std::max(result.max.x, uv.x), std::max(result.max.y, uv.y)};
      }
    }
  }
  result.min = {std::max(result.min.x, 0.f), std::max(result.min.y, 0.f)};
  result.max = {std::min(result.max.x, 1.f), std::min(result.max.y, 1.f)};
  result.valid = true;
  return result;
}

/// Looks for faces that TEXCOORD_1 squeezes to nothing, and fills the areas.
void check_area(const scene::Scene& scene, const scene::Instance& instance, SourceUv& result) {
  double uv_sum = 0, world_sum = 0, lost = 0;
  std::uint32_t lost_part = instance.first_part;
  all_triangles(scene, instance, [&](std::uint32_t t) {
    uv_sum += std::abs(uv_area(scene, t));
    world_sum += double(triangle_area(scene, t));
    return true;
  });
  all_triangles(scene, instance, [&](std::uint32_t t) {
    const double world = double(triangle_area(scene, t));
    if (std::abs(uv_area(scene, t)) > kThin * world * (uv_sum / world_sum)) return true;
    if (lost == 0) lost_part = scene.triangle_part[t];
    lost += world;
    return true;
  });
  if (lost > kTolerated * world_sum) {
    result =
        invalid(lost_part, percent(lost / world_sum) + " of the surface has no area in TEXCOORD_1");
    return;
  }
  result.uv_area = uv_sum;
  result.world_area = world_sum - lost;
}

/// Looks for connected pieces of mixed winding.
void check_folds(const scene::Scene& scene, const scene::Instance& instance,
                 const std::stop_token& stop, SourceUv& result) {
  const Surface surface = weld(scene, instance, WeldBy::kPositionAndUv, stop);
  if (stop.stop_requested()) return;
  std::uint32_t count = 0;
  const auto piece = connected_pieces(surface, &count, stop);
  if (stop.stop_requested()) return;
  struct Sides {
    double area[2] = {0, 0};
    std::uint32_t part = 0;
  };
  std::vector<Sides> sides(count);
  for (std::size_t i = 0; i < piece.size(); ++i) {
    const double a = uv_area(scene, surface.triangles[i]);
    sides[piece[i]].area[a < 0] += std::abs(a);
    sides[piece[i]].part = scene.triangle_part[surface.triangles[i]];
  }
  for (const Sides& s : sides) {
    const double least = std::min(s.area[0], s.area[1]), sum = s.area[0] + s.area[1];
    if (least <= kTolerated * sum) continue;
    result = invalid(s.part, "a connected piece of TEXCOORD_1 folds over itself (" +
                                 percent(least / sum) + " of it is flipped)");
    return;
  }
}

OverlapGrid::Triangle on_grid(const scene::Scene& scene, std::uint32_t triangle,
                              std::uint32_t size) {
  OverlapGrid::Triangle t;
  for (std::size_t i = 0; i < 3; ++i) {
    const math::Vec2 uv = scene.lightmap_uv[scene.triangles[triangle][i]];
    t[i] = {double(uv.x) * size, double(uv.y) * size};
  }
  return t;
}

/// Lays the instance's triangles on the grid, over those already there. Returns false at an
/// overlap, or when stopped; `where` is then the triangle.
bool lay_out(const scene::Scene& scene, const scene::Instance& instance, OverlapGrid& grid,
             std::uint32_t size, std::stop_token stop, std::uint32_t* where) {
  // So many shallow overlaps exceed kShallow of the samples of any layout.
  const std::uint64_t hopeless = std::uint64_t(size) * size / 32;
  std::uint64_t samples = 0, shallow = 0;
  std::uint32_t done = 0;
  const bool clear = all_triangles(scene, instance, [&](std::uint32_t t) {
    *where = t;
    if ((++done & 1023) == 0 && stop.stop_requested()) return false;
    const auto triangle = on_grid(scene, t, size);
    const auto found = grid.probe(triangle);
    if (found.deep_with != OverlapGrid::kNone) return false;
    grid.add(triangle);
    samples += found.samples, shallow += found.shallow;
    return shallow <= hopeless;
  });
  return clear && double(shallow) <= kShallow * double(samples) + 16;
}

bool same_layout(const scene::Scene& scene, const scene::Instance& a, const scene::Instance& b) {
  if (a.part_count != b.part_count) return false;
  for (std::uint32_t k = 0; k < a.part_count; ++k) {
    const scene::Part& p = scene.parts[a.first_part + k];
    const scene::Part& q = scene.parts[b.first_part + k];
    if (p.vertex_count != q.vertex_count || p.triangle_count != q.triangle_count) return false;
    const auto first = scene.lightmap_uv.begin();
    if (!std::equal(first + p.first_vertex, first + p.first_vertex + p.vertex_count,
                    first + q.first_vertex)) {
      return false;
    }
  }
  return true;
}

/// Tests each valid instance for overlaps. Instances of one mesh are tested once.
void check_overlaps(const scene::Scene& scene, std::uint32_t texels, std::stop_token stop,
                    std::vector<SourceUv>& results) {
  std::map<std::uint32_t, std::uint32_t> tested;  // mesh -> instance
  std::uint64_t layouts = 0;
  for (std::size_t i = 0; i < results.size(); ++i) {
    layouts += results[i].valid && tested.try_emplace(scene.instances[i].mesh, i).second;
  }
  if (layouts == 0) return;
  tested.clear();
  const std::uint64_t cells = kCellBudget / layouts;
  const auto side = std::uint32_t(std::sqrt(double(cells)));
  const std::uint32_t size = std::clamp(std::min(side, 2 * texels), 64u, 4096u);
  OverlapGrid grid;
  for (std::uint32_t i = 0; i < results.size() && !stop.stop_requested(); ++i) {
    if (!results[i].valid) continue;
    const auto [entry, fresh] = tested.try_emplace(scene.instances[i].mesh, i);
    if (!fresh && same_layout(scene, scene.instances[entry->second], scene.instances[i])) continue;
    std::uint32_t where = 0;
    grid.begin(size);
    if (lay_out(scene, scene.instances[i], grid, size, stop, &where)) continue;
    results[i] = invalid(scene.triangle_part[where], "faces overlap in TEXCOORD_1");
  }
  if (stop.stop_requested()) return;  // not all have been tested
  // A verdict holds for the other instances of the mesh, too.
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (!results[i].valid) continue;
    const std::uint32_t first = tested.at(scene.instances[i].mesh);
    if (results[first].valid || !same_layout(scene, scene.instances[first], scene.instances[i])) {
      continue;
    }
    const std::uint32_t part = results[first].part - scene.instances[first].first_part;
    results[i] = invalid(scene.instances[i].first_part + part, results[first].reason);
  }
}

}  // namespace

std::vector<SourceUv> check_source_uv(const scene::Scene& scene, std::uint32_t texels,
                                      std::stop_token stop) {
  std::vector<SourceUv> results;
  results.reserve(scene.instances.size());
  for (const scene::Instance& instance : scene.instances) {
    if (stop.stop_requested()) return {};
    results.push_back(check_range(scene, instance));
    SourceUv& result = results.back();
    if (result.valid) check_area(scene, instance, result);
    if (result.valid) check_folds(scene, instance, stop, result);
  }
  check_overlaps(scene, texels, stop, results);
  if (stop.stop_requested()) return {};
  return results;
}

bool share_one_page(const scene::Scene& scene, std::span<const std::uint32_t> instances,
                    std::uint32_t texels, std::stop_token stop) {
  if (instances.size() < 2) return true;
  const std::uint32_t size = std::clamp(2 * texels, 512u, 4096u);
  OverlapGrid grid;
  grid.begin(size);
  std::uint32_t where = 0;
  return std::all_of(instances.begin(), instances.end(), [&](std::uint32_t i) {
    return lay_out(scene, scene.instances[i], grid, size, stop, &where);
  });
}

}  // namespace kiln::atlas
