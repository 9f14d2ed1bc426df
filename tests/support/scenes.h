#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "baker/scene/scene.h"

/// Scenes built in memory, for tests of everything behind the import.
namespace kiln::test {

/// A triangle mesh; `uv` is TEXCOORD_1, empty for none. Vertices that the triangles share are
/// smooth.
struct Mesh {
  std::vector<math::Vec3> positions;
  std::vector<math::Vec2> uv;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  Mesh& append(const Mesh& other) {
    const auto base = std::uint32_t(positions.size());
    positions.insert(positions.end(), other.positions.begin(), other.positions.end());
    uv.insert(uv.end(), other.uv.begin(), other.uv.end());
    for (const auto& t : other.triangles)
      triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
    return *this;
  }
};

/// Parallelogram corner, corner + u, corner + u + v, corner + v; front towards cross(u, v).
/// Its uv spans the rectangle [uv_min, uv_max]: u along x, v along y.
inline Mesh quad(math::Vec3 corner, math::Vec3 u, math::Vec3 v, math::Vec2 uv_min = {0, 0},
                 math::Vec2 uv_max = {1, 1}) {
  return {{corner, corner + u, corner + u + v, corner + v},
          {uv_min, {uv_max.x, uv_min.y}, uv_max, {uv_min.x, uv_max.y}},
          {{0, 1, 2}, {0, 2, 3}}};
}

/// Axis-parallel cube with flat faces, without uv.
inline Mesh cube(float side) {
  const float h = side / 2;
  const math::Vec3 x{side, 0, 0}, y{0, side, 0}, z{0, 0, side};
  Mesh m;
  m.append(quad({-h, -h, h}, x, y)).append(quad({h, -h, -h}, -x, y));
  m.append(quad({h, -h, h}, -z, y)).append(quad({-h, -h, -h}, z, y));
  m.append(quad({-h, h, h}, x, -z)).append(quad({-h, -h, -h}, x, z));
  m.uv.clear();
  return m;
}

/// Sphere of `rings` x 2*rings cells around the origin, poles as fans, without uv.
inline Mesh sphere(float radius, std::uint32_t rings) {
  const std::uint32_t segments = 2 * rings;
  Mesh m;
  m.positions.push_back({0, radius, 0});
  for (std::uint32_t r = 1; r < rings; ++r) {
    const float theta = math::kPi * float(r) / float(rings);
    for (std::uint32_t s = 0; s < segments; ++s) {
      const float phi = 2 * math::kPi * float(s) / float(segments);
      m.positions.push_back({radius * std::sin(theta) * std::cos(phi), radius * std::cos(theta),
                             -radius * std::sin(theta) * std::sin(phi)});
    }
  }
  const auto last = std::uint32_t(m.positions.size());
  m.positions.push_back({0, -radius, 0});
  const auto at = [&](std::uint32_t ring, std::uint32_t s) {
    return 1 + (ring - 1) * segments + s % segments;
  };
  for (std::uint32_t s = 0; s < segments; ++s) {
    m.triangles.push_back({0, at(1, s), at(1, s + 1)});
    m.triangles.push_back({last, at(rings - 1, s + 1), at(rings - 1, s)});
    for (std::uint32_t r = 1; r + 1 < rings; ++r) {
      m.triangles.push_back({at(r, s), at(r + 1, s), at(r + 1, s + 1)});
      m.triangles.push_back({at(r, s), at(r + 1, s + 1), at(r, s + 1)});
    }
  }
  return m;
}

/// Collects meshes into a Scene as the import would: one part per mesh, flat arrays.
class SceneBuilder {
 public:
  std::uint32_t material(const scene::Material& m) {
    scene_.materials.push_back(m);
    return std::uint32_t(scene_.materials.size() - 1);
  }
  /// Begins a node; its parts follow. `mesh`: index in the imaginary glTF, nodes + 0 when not
  /// given.
  SceneBuilder& instance(std::int32_t mesh = -1) {
    scene::Instance i;
    i.node = std::uint32_t(scene_.instances.size());
    i.mesh = mesh < 0 ? i.node : std::uint32_t(mesh);
    i.name = "node" + std::to_string(i.node);
    i.first_part = std::uint32_t(scene_.parts.size());
    scene_.instances.push_back(i);
    return *this;
  }
  /// Adds a part to the last instance, moved by `offset`. Normals: mean of the faces at a vertex.
  SceneBuilder& part(const Mesh& mesh, std::uint32_t material = 0, math::Vec3 offset = {}) {
    if (scene_.instances.empty()) instance();
    if (scene_.materials.empty()) scene_.materials.push_back({{0.5f, 0.5f, 0.5f}, {}, {}, {}});
    scene::Part p;
    p.instance = std::uint32_t(scene_.instances.size() - 1);
    p.primitive = scene_.instances.back().part_count++;
    p.material = material;
    p.first_vertex = std::uint32_t(scene_.positions.size());
    p.vertex_count = std::uint32_t(mesh.positions.size());
    p.first_triangle = std::uint32_t(scene_.triangles.size());
    p.triangle_count = std::uint32_t(mesh.triangles.size());
    p.has_lightmap_uv = !mesh.uv.empty();
    std::vector<math::Vec3> normals(mesh.positions.size());
    for (const auto& t : mesh.triangles) {
      const math::Vec3 a = mesh.positions[t[0]];
      const math::Vec3 n = cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a);
      for (const std::uint32_t v : t) normals[v] += n;
      scene_.triangles.push_back(
          {t[0] + p.first_vertex, t[1] + p.first_vertex, t[2] + p.first_vertex});
      scene_.triangle_part.push_back(std::uint32_t(scene_.parts.size()));
    }
    for (std::uint32_t v = 0; v < p.vertex_count; ++v) {
      scene_.positions.push_back(mesh.positions[v] + offset);
      scene_.normals.push_back(normalize(normals[v]));
      scene_.lightmap_uv.push_back(mesh.uv.empty() ? math::Vec2{} : mesh.uv[v]);
      scene_.base_uv.push_back({});
      scene_.emission_uv.push_back({});
      scene_.colors.push_back({1, 1, 1, 1});
      scene_.source_vertex.push_back(v);
    }
    scene_.parts.push_back(p);
    return *this;
  }
  scene::Scene& scene() { return scene_; }
  scene::Scene build() { return std::move(scene_); }

 private:
  scene::Scene scene_;
};

}  // namespace kiln::test
