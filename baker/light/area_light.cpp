#include "baker/light/area_light.h"

#include <tuple>

#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"

namespace kiln::light {
namespace {

/// The points at which a textured emitter's mean is taken.
constexpr std::uint32_t kTexturePoints = 64;

math::Rgb mean_emission(const scene::Scene& scene, std::uint32_t triangle) {
  if (scene.material_of(triangle).emission_texture.image < 0)
    return emission_at(scene, triangle, scene::kCentroid);
  math::Rgb sum;
  for (std::uint32_t i = 0; i < kTexturePoints; ++i) {
    const math::Vec2 b = sampling::uniform_triangle(sampling::sample_pair(i, 1));
    sum += emission_at(scene, triangle, {b.x, b.y});
  }
  return sum * (1.f / kTexturePoints);
}

AreaLight make_light(std::array<math::Vec3, 4> corner, std::uint32_t corners, math::Rgb radiance) {
  AreaLight light;
  light.corner = corner;
  light.corners = corners;
  light.radiance = radiance;
  const math::Vec3 c = cross(light.first_edge(), light.second_edge());
  light.normal = normalize(c);
  light.area_m2 = corners == 3 ? length(c) / 2 : length(c);
  for (std::uint32_t k = 0; k < corners; ++k)
    light.longest_edge_m =
        std::max(light.longest_edge_m, length(corner[(k + 1) % corners] - corner[k]));
  return light;
}

/// One edge of an emitting triangle, its ends in an order that does not depend on the side from
/// which it is seen.
struct Edge {
  math::Vec3 low, high;
  std::uint32_t light = 0, from = 0;  ///< the edge runs from corner `from` to the next

  auto key() const { return std::tie(low.x, low.y, low.z, high.x, high.y, high.z); }
};

std::vector<Edge> edges_of(const std::vector<AreaLight>& lights) {
  std::vector<Edge> edges;
  for (std::uint32_t l = 0; l < lights.size(); ++l) {
    if (!lights[l].is_uniform()) continue;
    for (std::uint32_t k = 0; k < 3; ++k) {
      Edge e{lights[l].corner[k], lights[l].corner[(k + 1) % 3], l, k};
      if (std::tie(e.high.x, e.high.y, e.high.z) < std::tie(e.low.x, e.low.y, e.low.z))
        std::swap(e.low, e.high);
      edges.push_back(e);
    }
  }
  std::stable_sort(edges.begin(), edges.end(),
                   [](const Edge& a, const Edge& b) { return a.key() < b.key(); });
  return edges;
}

/// Returns the parallelogram that two triangles with a shared edge form, if they do.
bool join(const AreaLight& a, std::uint32_t edge_a, const AreaLight& b, std::uint32_t edge_b,
          AreaLight& joined) {
  constexpr float kFlat = 1 - 1e-6f, kParallel = 1e-5f;
  if (!(a.radiance == b.radiance) || a.two_sided != b.two_sided) return false;
  if (dot(a.normal, b.normal) < kFlat) return false;
  const math::Vec3 tip = a.corner[(edge_a + 2) % 3], start = a.corner[edge_a],
                   end = a.corner[(edge_a + 1) % 3], far = b.corner[(edge_b + 2) % 3];
  if (!(b.corner[edge_b] == end)) return false;  // wound the other way
  if (length(start + end - tip - far) > kParallel * a.longest_edge_m) return false;
  joined = make_light({tip, start, far, end}, 4, a.radiance);
  joined.two_sided = a.two_sided;
  return true;
}

std::vector<AreaLight> join_pairs(const std::vector<AreaLight>& triangles) {
  const std::vector<Edge> edges = edges_of(triangles);
  std::vector<AreaLight> lights;
  std::vector<bool> taken(triangles.size());
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    const Edge &a = edges[i], &b = edges[i + 1];
    if (a.key() != b.key() || taken[a.light] || taken[b.light] || a.light == b.light) continue;
    AreaLight joined;
    if (!join(triangles[a.light], a.from, triangles[b.light], b.from, joined)) continue;
    taken[a.light] = taken[b.light] = true;
    lights.push_back(joined);
  }
  for (std::size_t l = 0; l < triangles.size(); ++l)
    if (!taken[l]) lights.push_back(triangles[l]);
  return lights;
}

}  // namespace

float AreaLight::height_over(math::Vec3 p) const {
  const float height = dot(normal, p - corner[0]);
  const float rounding = std::max(max_abs(p), max_abs(corner[0])) * 0x1p-20f;
  return std::abs(height) <= rounding ? 0 : height;
}

float AreaLight::clearance(math::Vec3 receiver) const {
  float largest = max_abs(receiver);
  for (const math::Vec3& c : corner) largest = std::max(largest, max_abs(c));
  return largest * 0x1p-18f;
}

float AreaLight::least_distance(math::Vec3 p) const {
  return std::max(std::abs(dot(normal, p - corner[0])), length(center() - p) - longest_edge_m);
}

simd::LightShape AreaLight::shape() const {
  simd::LightShape s;
  for (std::uint32_t c = 0; c < 4; ++c) {
    const math::Vec3 v = corner[std::min(c, corners - 1)];
    s.corner[c][0] = v.x, s.corner[c][1] = v.y, s.corner[c][2] = v.z;
  }
  s.normal[0] = normal.x, s.normal[1] = normal.y, s.normal[2] = normal.z;
  s.area_m2 = area_m2;
  s.corners = std::int32_t(corners);
  return s;
}

std::vector<AreaLight> find_area_lights(const scene::Scene& scene, bool surfaces) {
  std::vector<AreaLight> triangles;
  for (std::uint32_t t = 0; surfaces && t < scene.triangles.size(); ++t) {
    if (!is_emissive(scene, t)) continue;
    const auto& v = scene.triangles[t];
    AreaLight light =
        make_light({scene.positions[v[0]], scene.positions[v[1]], scene.positions[v[2]], {}}, 3,
                   mean_emission(scene, t));
    const scene::Material& material = scene.material_of(t);
    if (material.emission_texture.image >= 0) light.textured = t;
    light.two_sided = material.double_sided;
    triangles.push_back(light);
  }
  std::vector<AreaLight> lights = join_pairs(triangles);
  for (const scene::RectLight& r : scene.rect_lights)
    lights.push_back(make_light(
        {r.corner, r.corner + r.edge_u, r.corner + r.edge_u + r.edge_v, r.corner + r.edge_v}, 4,
        r.radiance));
  return lights;
}

}  // namespace kiln::light
