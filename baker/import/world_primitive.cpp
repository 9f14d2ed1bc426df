#include "baker/import/world_primitive.h"

#include <algorithm>
#include <functional>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/scene/scene.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;
using Triangle = std::array<std::uint32_t, 3>;

constexpr float kMaxCoordinate = 1e9f;  // m; squared areas of larger triangles overflow

/// Triangles of one primitive and the vertices they name.
struct Assembly {
  std::vector<std::uint32_t> used;  ///< source vertices, ascending
  std::vector<Triangle> triangles;  ///< into `used`, glTF order
};

/// The vertices that the triangles name, by a table: for corners close together.
void compact_by_table(Assembly& p, std::uint32_t low, std::uint32_t high, exec::StopPoll& stopped) {
  std::vector<std::uint32_t> place(std::size_t(high) - low + 1, 0);
  for (const Triangle& t : p.triangles) {
    if (stopped()) return;
    for (const std::uint32_t v : t) place[v - low] = 1;
  }
  for (std::size_t i = 0; i < place.size(); ++i) {
    if (stopped()) return;
    if (place[i] == 0) continue;
    place[i] = static_cast<std::uint32_t>(p.used.size());
    p.used.push_back(low + static_cast<std::uint32_t>(i));
  }
  for (Triangle& t : p.triangles) {
    if (stopped()) return;
    for (std::uint32_t& v : t) v = place[v - low];
  }
}

/// Does the same by sorting, for corners that lie far apart.
void compact_by_sort(Assembly& p, exec::StopPoll& stopped, const std::stop_token& stop) {
  p.used.reserve(3 * p.triangles.size());
  for (const Triangle& t : p.triangles) p.used.insert(p.used.end(), t.begin(), t.end());
  if (!exec::sort_unless_stopped(p.used, std::less<>(), stop)) return;
  p.used.erase(std::unique(p.used.begin(), p.used.end()), p.used.end());
  for (Triangle& t : p.triangles) {
    if (stopped()) return;
    for (std::uint32_t& v : t) {
      v = static_cast<std::uint32_t>(std::lower_bound(p.used.begin(), p.used.end(), v) -
                                     p.used.begin());
    }
  }
}

/// Fills `used` and makes the triangles' corners, source vertices so far, indices into it.
void compact(Assembly& p, exec::StopPoll& stopped, const std::stop_token& stop) {
  std::uint32_t low = 0xffffffffu, high = 0;
  for (const Triangle& t : p.triangles) {
    low = std::min({low, t[0], t[1], t[2]});
    high = std::max({high, t[0], t[1], t[2]});
  }
  const std::uint64_t corners = 3 * p.triangles.size();
  if (std::uint64_t(high) - low < 8 * corners + 1024) {  // a table costs no more than the triangles
    compact_by_table(p, low, high, stopped);
  } else {
    compact_by_sort(p, stopped, stop);
  }
}

proto::Expected<Assembly> assemble(const PrimitiveSource& source, const std::stop_token& stop) {
  exec::StopPoll stopped(stop);
  Assembly out;
  out.triangles.resize(source.triangle_count);
  for (std::uint64_t i = 0; i < source.triangle_count; ++i) {
    if (stopped()) return exec::canceled();
    out.triangles[i] = source.triangle(i);
  }
  compact(out, stopped, stop);
  if (stop.stop_requested()) return exec::canceled();
  return out;
}

// Placing -----------------------------------------------------------------------------------------

math::Vec3 face_normal(const WorldPrimitive& w, const Triangle& t) {
  return normalize(
      cross(w.positions[t[1]] - w.positions[t[0]], w.positions[t[2]] - w.positions[t[0]]));
}

/// A vertex in world space.
Expected<math::Vec3> world_point(const PrimitiveSource& source, std::uint32_t vertex,
                                 const Transform& to_world) {
  const auto p = source.positions.floats(vertex);
  const math::Vec3 point = to_world.point({p[0], p[1], p[2]});
  if (!(max_abs(point) <= kMaxCoordinate)) {
    return gltf::invalid("vertex " + std::to_string(vertex) + " lies beyond 1e9 m in world space",
                         source.pointer + "/attributes/POSITION");
  }
  return point;
}

/// Makes three vertices for each triangle, with the triangle's normal.
void emit_flat(WorldPrimitive& out, const std::vector<std::uint32_t>& used,
               const std::vector<math::Vec3>& points, exec::StopPoll& stopped) {
  const std::size_t corners = 3 * out.triangles.size();
  out.positions.reserve(corners);
  out.normals.reserve(corners);
  out.source_vertex.reserve(corners);
  for (Triangle& t : out.triangles) {
    if (stopped()) return;
    const auto first = static_cast<std::uint32_t>(out.positions.size());
    for (const std::uint32_t v : t) {
      out.positions.push_back(points[v]);
      out.source_vertex.push_back(used[v]);
    }
    t = {first, first + 1, first + 2};
    out.normals.insert(out.normals.end(), 3, face_normal(out, t));
  }
}

/// Vertices without a normal get the sum of their faces' area vectors.
void repair_normals(WorldPrimitive& out, const std::vector<bool>& broken, exec::StopPoll& stopped) {
  for (const Triangle& t : out.triangles) {
    if (stopped()) return;
    const math::Vec3 area =
        cross(out.positions[t[1]] - out.positions[t[0]], out.positions[t[2]] - out.positions[t[0]]);
    for (const std::uint32_t v : t) {
      if (broken[v]) out.normals[v] += area;
    }
  }
  for (const Triangle& t : out.triangles) {
    if (stopped()) return;
    for (const std::uint32_t v : t) {
      if (broken[v]) out.normals[v] = normalize(out.normals[v], face_normal(out, t));
    }
  }
}

/// Puts vertices in source order and leaves out those that no triangle uses any more.
void emit_smooth(WorldPrimitive& out, const gltf::AccessorView& normals,
                 const std::vector<std::uint32_t>& used, const std::vector<math::Vec3>& points,
                 const Transform& to_world, exec::StopPoll& stopped) {
  constexpr std::uint32_t kUnused = 0xffffffffu;
  std::vector<std::uint32_t> place(points.size(), kUnused);
  for (const Triangle& t : out.triangles) {
    if (stopped()) return;
    for (const std::uint32_t v : t) place[v] = 0;
  }
  Transform normal_map;  // inverse transpose, up to a positive factor
  normal_map.m = to_world.cofactors();
  const float side = to_world.determinant() < 0 ? -1.f : 1.f;
  std::vector<bool> broken;
  for (std::uint32_t v = 0; v < points.size(); ++v) {
    if (stopped()) return;
    if (place[v] == kUnused) continue;
    place[v] = static_cast<std::uint32_t>(out.positions.size());
    const auto n = normals.floats(used[v]);
    const math::Vec3 unit = math::normalize({n[0], n[1], n[2]}, {0, 0, 0});
    const math::Vec3 normal =
        normalize(normalize(normal_map.direction(unit), {0, 0, 0}) * side, {0, 0, 0});
    broken.push_back(normal == math::Vec3{0, 0, 0});
    out.broken_normals += broken.back() ? 1 : 0;
    out.positions.push_back(points[v]);
    out.normals.push_back(normal);
    out.source_vertex.push_back(used[v]);
  }
  for (Triangle& t : out.triangles) {
    if (stopped()) return;
    t = {place[t[0]], place[t[1]], place[t[2]]};
  }
  if (out.broken_normals > 0) repair_normals(out, broken, stopped);
}

}  // namespace

proto::Expected<WorldPrimitive> place_primitive(const PrimitiveSource& source,
                                                const Transform& to_world,
                                                const std::stop_token& stop) {
  const auto assembly = assemble(source, stop);
  if (!assembly) return Unexpected(assembly.error());
  exec::StopPoll stopped(stop);
  std::vector<math::Vec3> points(assembly->used.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (stopped()) return exec::canceled();
    const auto point = world_point(source, assembly->used[i], to_world);
    if (!point) return Unexpected(point.error());
    points[i] = *point;
  }
  const bool mirrored = to_world.determinant() < 0;
  WorldPrimitive out;
  for (std::size_t i = 0; i < assembly->triangles.size(); ++i) {
    if (stopped()) return exec::canceled();
    const Triangle t = assembly->triangles[i];
    if (!scene::has_area(points[t[0]], points[t[1]], points[t[2]])) {
      ++out.degenerate;
      continue;
    }
    out.triangles.push_back(mirrored ? Triangle{t[0], t[2], t[1]} : t);
  }
  if (source.normals) {
    emit_smooth(out, *source.normals, assembly->used, points, to_world, stopped);
  } else {
    emit_flat(out, assembly->used, points, stopped);
  }
  if (stop.stop_requested()) return exec::canceled();
  return out;
}

proto::Expected<bool> has_triangles(const PrimitiveSource& source, const Transform& to_world,
                                    const std::stop_token& stop) {
  exec::StopPoll stopped(stop);
  bool any = false;
  for (std::uint64_t i = 0; i < source.triangle_count; ++i) {
    if (stopped()) return exec::canceled();
    const Triangle t = source.triangle(i);
    std::array<math::Vec3, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto point = world_point(source, t[k], to_world);
      if (!point) return Unexpected(point.error());
      corner[k] = *point;
    }
    any = any || scene::has_area(corner[0], corner[1], corner[2]);
  }
  return any;
}

}  // namespace kiln::import
