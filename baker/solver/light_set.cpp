#include "baker/solver/light_set.h"

#include <limits>

#include "baker/solver/sampling.h"

namespace kiln::baker {
namespace {

/// A light whose longest edge is more than so many times its distance is sampled by solid angle.
constexpr float kNearRatio = 1;
/// A uniform direction to what `from` sees of the light.
struct SphericalLight {
  SphericalTriangle first, second;
  float solid_angle;

  SphericalLight(const AreaLight& l, Vec3 from)
      : first(from, l.corner[0], l.corner[1], l.corner[2]),
        second(from, l.corner[0], l.corner[2], l.corner[l.corners - 1]),
        solid_angle(first.solid_angle + (l.corners == 4 ? second.solid_angle : 0)) {}

  Vec3 sample(Vec2 u) const {
    const float share = first.solid_angle / solid_angle;
    if (u.x < share) return first.sample({u.x / share, u.y});
    return second.sample({std::min(1.f, (u.x - share) / (1 - share)), u.y});
  }
};

Vec3 uniform_point(const AreaLight& l, Vec2 u) {
  const Vec2 b = l.corners == 3 ? uniform_triangle(u) : u;
  return l.corner[0] + l.first_edge() * b.x + l.second_edge() * b.y;
}

/// A point of the light moved off it, to the side that `height` tells; a light nearer than that
/// keeps its distance, all but a quarter.
Vec3 move_off(const AreaLight& l, Vec3 point, Vec3 receiver, float height) {
  const float off = std::min(l.clearance(receiver), std::abs(height) / 4);
  return point + l.normal * std::copysign(off, height);
}

std::vector<float> power_shares(const std::vector<AreaLight>& lights) {
  double total = 0;
  for (const AreaLight& l : lights) total += luminance(l.radiance) * l.area_m2;
  std::vector<float> shares;
  for (const AreaLight& l : lights)
    shares.push_back(total > 0 ? float(luminance(l.radiance) * l.area_m2 / total)
                               : 1.f / float(lights.size()));
  return shares;
}

}  // namespace

LightSet::LightSet(const Scene& scene)
    : scene_(scene),
      area_(find_area_lights(scene)),
      power_share_(power_shares(area_)),
      table_(area_, power_share_) {
  if (!scene.sky_map.empty()) sky_.emplace(scene);
}

bool LightSet::is_near(const AreaLight& l, Vec3 from, float ratio) {
  return l.longest_edge_m > ratio * length(l.centre() - from);
}

LightSample LightSet::sample(const AreaLight& l, Vec3 from, Vec2 u) const {
  LightSample s;
  const float height = l.height_over(from);
  if (!l.shows_to(height)) return s;
  Vec3 point;         // of the light
  float density = 0;  // per steradian
  if (is_near(l, from, kNearRatio)) {
    const SphericalLight seen(l, from);
    if (!(seen.solid_angle > 0)) return s;
    s.direction = seen.sample(u);
    const float slope = -dot(l.normal, s.direction);
    if (slope * height <= 0) return s;
    point = from + s.direction * (height / slope);
    density = 1 / seen.solid_angle;
  } else {
    point = uniform_point(l, u);
    const Vec3 d = point - from;
    const float r2 = dot(d, d);
    s.direction = d * (1 / std::sqrt(r2));
    density = r2 / (l.area_m2 * std::abs(dot(l.normal, s.direction)));
  }
  Rgb radiance = l.radiance;
  if (!l.is_uniform()) {
    // Barycentric coordinates of the point, by areas projected along the normal.
    const float scale = 1 / (2 * l.area_m2);
    const float bu = dot(cross(point - l.corner[0], l.second_edge()), l.normal) * scale;
    const float bv = dot(cross(l.first_edge(), point - l.corner[0]), l.normal) * scale;
    radiance = emission_at(scene_, l.textured, {bu, bv});
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
