#include "baker/atlas/weld.h"

#include <algorithm>
#include <numeric>
#include <tuple>

#include "baker/exec/stop.h"

namespace kiln::atlas {
namespace {

struct Corner {
  math::Vec3 p;
  math::Vec2 uv;
  std::uint32_t vertex = 0;

  auto key() const { return std::tie(p.x, p.y, p.z, uv.x, uv.y); }
};

/// Returns one number per scene vertex of the instance (relative to the first one), equal where
/// vertices are welded. The list is empty when stopped.
std::vector<std::uint32_t> weld_vertices(const scene::Scene& scene, const scene::Instance& instance,
                                         WeldBy by, std::uint32_t first_vertex,
                                         std::uint32_t end_vertex, const std::stop_token& stop) {
  exec::StopPoll stopped(stop);
  std::vector<Corner> corners;
  corners.reserve(end_vertex - first_vertex);
  for (std::uint32_t k = 0; k < instance.part_count; ++k) {
    const scene::Part& part = scene.parts[instance.first_part + k];
    for (std::uint32_t i = 0; i < part.vertex_count; ++i) {
      if (stopped()) return {};
      const std::uint32_t v = part.first_vertex + i;
      const math::Vec2 uv = by == WeldBy::kPosition ? math::Vec2{} : scene.lightmap_uv[v];
      corners.push_back({scene.positions[v], uv, v});
    }
  }
  const auto before = [](const Corner& a, const Corner& b) {
    return a.key() != b.key() ? a.key() < b.key() : a.vertex < b.vertex;
  };
  if (!exec::sort_unless_stopped(corners, before, stop)) return {};
  std::vector<std::uint32_t> id(end_vertex - first_vertex, 0);
  std::uint32_t next = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (stopped()) return {};
    if (i > 0 && corners[i].key() != corners[i - 1].key()) ++next;
    id[corners[i].vertex - first_vertex] = next;
  }
  return id;
}

struct HalfEdge {
  std::uint32_t low = 0, high = 0;
  std::uint32_t triangle = 0;  ///< index into Surface::triangles
  std::uint8_t edge = 0;
  bool ascending = false;  ///< it runs from low to high
  bool double_sided = false;

  auto key() const { return std::tie(low, high); }
};

std::uint32_t find(std::vector<std::uint32_t>& parent, std::uint32_t i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

}  // namespace

Surface weld(const scene::Scene& scene, const scene::Instance& instance, WeldBy by,
             const std::stop_token& stop) {
  Surface surface;
  std::uint32_t first_vertex = 0xffffffffu, end_vertex = 0;
  for (std::uint32_t k = 0; k < instance.part_count; ++k) {
    const scene::Part& part = scene.parts[instance.first_part + k];
    first_vertex = std::min(first_vertex, part.first_vertex);
    end_vertex = std::max(end_vertex, part.first_vertex + part.vertex_count);
    for (std::uint32_t i = 0; i < part.triangle_count; ++i) {
      surface.triangles.push_back(part.first_triangle + i);
    }
  }
  if (surface.triangles.empty()) return surface;
  std::sort(surface.triangles.begin(), surface.triangles.end());
  const auto id = weld_vertices(scene, instance, by, first_vertex, end_vertex, stop);
  if (id.empty()) return {};
  exec::StopPoll stopped(stop);
  std::vector<HalfEdge> edges;
  edges.reserve(surface.triangles.size() * 3);
  for (std::uint32_t t = 0; t < surface.triangles.size(); ++t) {
    if (stopped()) return {};
    const auto& v = scene.triangles[surface.triangles[t]];
    const bool two = scene.material_of(surface.triangles[t]).double_sided;
    for (std::uint8_t k = 0; k < 3; ++k) {
      const std::uint32_t a = id[v[k] - first_vertex], b = id[v[(k + 1) % 3] - first_vertex];
      if (a != b) edges.push_back({std::min(a, b), std::max(a, b), t, k, a < b, two});
    }
  }
  const auto before = [](const HalfEdge& a, const HalfEdge& b) {
    return a.key() != b.key() ? a.key() < b.key()
                              : std::tie(a.triangle, a.edge) < std::tie(b.triangle, b.edge);
  };
  if (!exec::sort_unless_stopped(edges, before, stop)) return {};
  surface.neighbor.assign(surface.triangles.size(),
                          {Surface::kNone, Surface::kNone, Surface::kNone});
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    if (stopped()) return {};
    while (end < edges.size() && edges[end].key() == edges[begin].key()) ++end;
    if (end - begin != 2) continue;
    const HalfEdge &a = edges[begin], &b = edges[begin + 1];
    const bool same_side = by == WeldBy::kPositionAndUv || a.ascending != b.ascending;
    if (!same_side || a.double_sided != b.double_sided || a.triangle == b.triangle) continue;
    surface.neighbor[a.triangle][a.edge] = b.triangle;
    surface.neighbor[b.triangle][b.edge] = a.triangle;
  }
  return surface;
}

std::vector<std::uint32_t> connected_pieces(const Surface& surface, std::uint32_t* count,
                                            const std::stop_token& stop) {
  exec::StopPoll stopped(stop);
  *count = 0;
  const auto n = std::uint32_t(surface.triangles.size());
  std::vector<std::uint32_t> parent(n);
  std::iota(parent.begin(), parent.end(), 0u);
  for (std::uint32_t t = 0; t < n; ++t) {
    if (stopped()) return {};
    for (const std::uint32_t other : surface.neighbor[t]) {
      if (other == Surface::kNone) continue;
      const std::uint32_t a = find(parent, t), b = find(parent, other);
      parent[std::max(a, b)] = std::min(a, b);  // a root is its piece's first triangle
    }
  }
  std::vector<std::uint32_t> piece(n);
  std::uint32_t next = 0;
  for (std::uint32_t t = 0; t < n; ++t) {
    if (stopped()) return {};
    const std::uint32_t root = find(parent, t);
    piece[t] = root == t ? next++ : piece[root];
  }
  *count = next;
  return piece;
}

}  // namespace kiln::atlas
