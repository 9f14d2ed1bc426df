#include "baker/solver/light_set.h"

#include <limits>

#include "baker/solver/sampling.h"
#include "baker/solver/sobol.h"
#include "baker/trace/ray_scene.h"

namespace kiln::baker {
namespace {

/// A light whose longest edge is above this share of its distance is sampled by solid angle.
constexpr float kNearRatio = 1;
/// Points at which a textured emitter's mean is taken.
constexpr std::uint32_t kTexturePoints = 64;

Rgb mean_emission(const Scene& scene, std::uint32_t triangle) {
  if (scene.material_of(triangle).emission_texture.image < 0)
    return emission_at(scene, triangle, kCentroid);
  Rgb sum;
  for (std::uint32_t i = 0; i < kTexturePoints; ++i) {
    const Vec2 b = uniform_triangle(sample_pair(i, 1));
    sum += emission_at(scene, triangle, {b.x, b.y});
  }
  return sum * (1.f / kTexturePoints);
}

AreaLight make_area_light(Vec3 p0, Vec3 p1, Vec3 p2, Rgb radiance) {
  AreaLight light;
  light.p0 = p0, light.p1 = p1, light.p2 = p2;
  const Vec3 c = cross(p1 - p0, p2 - p0);
  light.normal = normalize(c);
  light.area_m2 = length(c) / 2;
  light.radiance = radiance;
  light.triangle = kNoHit;
  return light;
}

/// Height of `p` over the plane of the light, m; 0 within the rounding of the coordinates, so that
/// a flat lamp far from the origin does not light itself.
float height_over(const AreaLight& l, Vec3 p) {
  const float height = dot(l.normal, p - l.p0);
  const float rounding = std::max(max_abs(p), max_abs(l.p0)) * 0x1p-20f;
  return std::abs(height) <= rounding ? 0 : height;
}

/// A point of the light moved off it, to the side that `height` tells, by as much as the origins of
/// rays are moved off their surfaces: the light must not stand in the way of its own shadow rays.
/// A light nearer than that keeps its distance, all but a quarter.
Vec3 move_off(const AreaLight& l, Vec3 point, Vec3 receiver, float height) {
  const float offset = std::max(max_abs(point), max_abs(receiver)) * 0x1p-18f;
  return point + l.normal * std::copysign(std::min(offset, std::abs(height) / 4), height);
}

float longest_edge(const AreaLight& l) {
  return std::sqrt(std::max({dot(l.p1 - l.p0, l.p1 - l.p0), dot(l.p2 - l.p1, l.p2 - l.p1),
                             dot(l.p0 - l.p2, l.p0 - l.p2)}));
}

}  // namespace

LightSet::LightSet(const Scene& scene) : scene_(scene) {
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (!is_emissive(scene, t)) continue;
    const auto& v = scene.triangles[t];
    AreaLight light = make_area_light(scene.positions[v[0]], scene.positions[v[1]],
                                      scene.positions[v[2]], mean_emission(scene, t));
    light.triangle = t;
    light.two_sided = scene.material_of(t).double_sided;
    area_.push_back(light);
  }
  for (const RectLight& r : scene.rect_lights) {
    const Vec3 far = r.corner + r.edge_u + r.edge_v;
    area_.push_back(make_area_light(r.corner, r.corner + r.edge_u, far, r.radiance));
    area_.push_back(make_area_light(r.corner, far, r.corner + r.edge_v, r.radiance));
  }
  double total = 0;
  for (const AreaLight& l : area_) total += luminance(l.radiance) * l.area_m2;
  for (const AreaLight& l : area_)
    power_share_.push_back(total > 0 ? float(luminance(l.radiance) * l.area_m2 / total)
                                     : 1.f / float(area_.size()));
}

float LightSet::unoccluded_estimate(const AreaLight& l, Vec3 p, Vec3 n) const {
  const float height = height_over(l, p);
  if (height == 0 || (height < 0 && !l.two_sided)) return 0;
  return luminance(l.radiance) * triangle_irradiance(p, n, l.p0, l.p1, l.p2);
}

float LightSet::least_distance(const AreaLight& l, Vec3 p) const {
  const Vec3 to_centre = (l.p0 + l.p1 + l.p2) * (1.f / 3) - p;
  return std::max(std::abs(dot(l.normal, p - l.p0)), length(to_centre) - longest_edge(l));
}

LightSample LightSet::sample(const AreaLight& l, Vec3 from, Vec2 u) const {
  LightSample s;
  const float height = height_over(l, from);
  if (height == 0 || (height < 0 && !l.two_sided)) return s;
  const Vec3 centre = (l.p0 + l.p1 + l.p2) * (1.f / 3);
  const Vec3 to_centre = centre - from;
  Vec3 point;         // of the light
  float density = 0;  // per steradian
  if (longest_edge(l) > kNearRatio * length(to_centre)) {
    const SphericalTriangle seen(from, l.p0, l.p1, l.p2);
    if (!(seen.solid_angle > 0)) return s;
    s.direction = seen.sample(u);
    const float slope = -dot(l.normal, s.direction);
    if (slope * height <= 0) return s;
    point = from + s.direction * (height / slope);
    density = 1 / seen.solid_angle;
  } else {
    const Vec2 b = uniform_triangle(u);
    point = interpolate(l.p0, l.p1, l.p2, {b.x, b.y});
    const Vec3 d = point - from;
    const float r2 = dot(d, d);
    s.direction = d * (1 / std::sqrt(r2));
    density = r2 / (l.area_m2 * std::abs(dot(l.normal, s.direction)));
  }
  Rgb radiance = l.radiance;
  if (l.triangle != kNoHit && scene_.material_of(l.triangle).emission_texture.image >= 0) {
    // Barycentric coordinates of the point, by areas projected along the normal.
    const float scale = 1 / (2 * l.area_m2);
    const float bu = dot(cross(point - l.p0, l.p2 - l.p0), l.normal) * scale;
    const float bv = dot(cross(l.p1 - l.p0, point - l.p0), l.normal) * scale;
    radiance = emission_at(scene_, l.triangle, {bu, bv});
  }
  s.end = move_off(l, point, from, height);
  s.value = radiance * (1 / density);
  return s;
}

ShadowRay PunctualArrival::shadow_ray(Vec3 origin) const {
  if (!position) return {direction, std::numeric_limits<float>::infinity()};
  // A lamp that hangs right at a ceiling is not shadowed by it.
  constexpr float kReach = 1 - 1e-4f;
  return {*position - origin, kReach};
}

PunctualArrival arrive(const PunctualLight& l, Vec3 at) {
  PunctualArrival a;
  if (l.type == PunctualType::kDirectional) {
    a.direction = -l.direction;
    a.irradiance = l.intensity;
    return a;
  }
  const Vec3 d = l.position - at;
  const float r2 = dot(d, d);
  if (r2 <= 0) return a;
  a.position = l.position;
  a.direction = d * (1 / std::sqrt(r2));
  float strength = 1 / r2;
  if (l.range > 0) {
    const float x2 = r2 / (l.range * l.range);
    strength *= std::clamp(1 - x2 * x2, 0.f, 1.f);
  }
  if (l.type == PunctualType::kSpot) {
    const float cosine = -dot(l.direction, a.direction);
    const float width = std::max(0.001f, l.cos_inner - l.cos_outer);
    const float t = std::clamp((cosine - l.cos_outer) / width, 0.f, 1.f);
    strength *= t * t;
  }
  a.irradiance = l.intensity * strength;
  return a;
}

}  // namespace kiln::baker
