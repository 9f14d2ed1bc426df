#include "baker/light/light_set.h"

#include "baker/sampling/shapes.h"

namespace kiln::light {
namespace {

/// A light is sampled by solid angle when its longest edge is more than this many times its
/// distance.
constexpr float kNearRatio = 1;

math::Vec3 uniform_point(const AreaLight& l, math::Vec2 u) {
  const math::Vec2 b = l.corners == 3 ? sampling::uniform_triangle(u) : u;
  return l.corner[0] + l.first_edge() * b.x + l.second_edge() * b.y;
}

std::vector<float> power_shares(const std::vector<AreaLight>& lights) {
  double total = 0;
  for (const AreaLight& l : lights) total += luminance(l.radiance) * l.area_m2;
  std::vector<float> shares;
  shares.reserve(lights.size());
  for (const AreaLight& l : lights)
    shares.push_back(total > 0 ? float(luminance(l.radiance) * l.area_m2 / total)
                               : 1.f / float(lights.size()));
  return shares;
}

}  // namespace

LightSet::LightSet(const scene::Scene& scene, const exec::Workers* workers, bool surfaces)
    : scene_(scene),
      area_(find_area_lights(scene, surfaces)),
      power_share_(power_shares(area_)),
      table_(area_, power_share_) {
  if (!scene.sky_map.empty()) sky_.emplace(scene, workers);
}

bool LightSet::is_near(const AreaLight& l, math::Vec3 from, float ratio) {
  return l.longest_edge_m > ratio * length(l.center() - from);
}

AreaLightSampler::Spherical::Spherical(const AreaLight& l, math::Vec3 from)
    : first(from, l.corner[0], l.corner[1], l.corner[2]),
      second(from, l.corner[0], l.corner[2], l.corner[l.corners - 1]),
      solid_angle(first.solid_angle + (l.corners == 4 ? second.solid_angle : 0)) {}

math::Vec3 AreaLightSampler::Spherical::sample(math::Vec2 u) const {
  const float share = first.solid_angle / solid_angle;
  if (u.x < share) return first.sample({u.x / share, u.y});
  return second.sample({std::min(1.f, (u.x - share) / (1 - share)), u.y});
}

AreaLightSampler::AreaLightSampler(const scene::Scene& scene, const AreaLight& light,
                                   math::Vec3 from, Spread spread)
    : scene_(scene), light_(light), from_(from) {
  const float height = light.height_over(from);
  if (!light.shows_to(height)) return;
  height_ = height;
  // The offset goes to the receiver's side. It is at most a quarter of the receiver's height.
  move_off_ = std::copysign(std::min(light.clearance(from), std::abs(height) / 4), height);
  if (spread == Spread::kSolidAngle && LightSet::is_near(light, from, kNearRatio))
    near_.emplace(light, from);
}

LightSample AreaLightSampler::sample(math::Vec2 u) const {
  LightSample s;
  if (height_ == 0) return s;
  math::Vec3 point;   // on the light
  float density = 0;  // per steradian
  if (near_) {
    if (!(near_->solid_angle > 0)) return s;
    s.direction = near_->sample(u);
    const float slope = -dot(light_.normal, s.direction);
    if (slope * height_ <= 0) return s;
    point = from_ + s.direction * (height_ / slope);
    density = 1 / near_->solid_angle;
  } else {
    point = uniform_point(light_, u);
    const math::Vec3 d = point - from_;
    const float r2 = dot(d, d);
    s.direction = d * (1 / std::sqrt(r2));
    density = r2 / (light_.area_m2 * std::abs(dot(light_.normal, s.direction)));
  }
  s.end = point + light_.normal * move_off_;
  s.value = (light_.is_uniform() ? light_.radiance : radiance_at(point)) * (1 / density);
  return s;
}

/// Returns the radiance of a textured light. The barycentric coordinates of the point come from
/// areas projected along the normal.
math::Rgb AreaLightSampler::radiance_at(math::Vec3 point) const {
  const float scale = 1 / (2 * light_.area_m2);
  const math::Vec3 p = point - light_.corner[0];
  const float u = dot(cross(p, light_.second_edge()), light_.normal) * scale;
  const float v = dot(cross(light_.first_edge(), p), light_.normal) * scale;
  return emission_at(scene_, light_.textured, {u, v});
}

ShadowRay PunctualSample::shadow_ray(math::Vec3 origin) const {
  if (!position) return ShadowRay::endless(direction);
  // A lamp that hangs right at a ceiling is not shadowed by it.
  constexpr float kReach = 1 - 1e-4f;
  return {*position - origin, kReach};
}

PunctualSample sample_punctual(const scene::PunctualLight& l, math::Vec3 at) {
  PunctualSample a;
  if (l.type == scene::PunctualType::kDirectional) {
    a.direction = -l.direction;
    a.irradiance = l.intensity;
    return a;
  }
  const math::Vec3 d = l.position - at;
  const float r2 = dot(d, d);
  if (r2 <= 0) return a;
  a.position = l.position;
  a.direction = d * (1 / std::sqrt(r2));
  float strength = 1 / r2;
  if (l.range > 0) {
    const float x2 = r2 / (l.range * l.range);
    strength *= std::clamp(1 - x2 * x2, 0.f, 1.f);
  }
  if (l.type == scene::PunctualType::kSpot) {
    const float cosine = -dot(l.direction, a.direction);
    const float width = std::max(0.001f, l.cos_inner - l.cos_outer);
    const float t = std::clamp((cosine - l.cos_outer) / width, 0.f, 1.f);
    strength *= t * t;
  }
  a.irradiance = l.intensity * strength;
  return a;
}

}  // namespace kiln::light
