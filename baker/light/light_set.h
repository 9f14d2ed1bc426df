#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "baker/light/area_light.h"
#include "baker/light/light_table.h"
#include "baker/light/sky_light.h"
#include "baker/math/vec.h"
#include "baker/sampling/shapes.h"
#include "baker/scene/scene.h"

namespace kiln::light {

/// The points origin + t * direction, t in (0, far), that must be free for a light to be seen.
struct ShadowRay {
  math::Vec3 direction;  ///< not normalized
  float far = 1;

  static ShadowRay endless(math::Vec3 direction) {
    return {direction, std::numeric_limits<float>::infinity()};
  }
};

/// A sampled point of an area light, seen from the receiver.
struct LightSample {
  math::Vec3 direction;  ///< unit, towards the light
  math::Vec3 end;        ///< where shadow rays end, m: just off the light, on the receiver's side
  math::Rgb value;  ///< radiance over the solid-angle density of the direction; 0: nothing seen

  ShadowRay shadow_ray(math::Vec3 origin) const { return {end - origin, 1}; }
};

/// How the points of an area light are spread.
enum class Spread {
  kSolidAngle,  ///< evenly over its solid angle when it is near against its size: bounded, no 1/d2
  kArea,        ///< evenly over its area
};

/// An area light as one point sees it, ready to be sampled. Where the spread is not even in solid
/// angle it is so in area. Scene and light live longer.
class AreaLightSampler {
 public:
  AreaLightSampler(const scene::Scene&, const AreaLight&, math::Vec3 from,
                   Spread = Spread::kSolidAngle);

  /// Returns a direction to a point of the light by the uniform pair `u`.
  LightSample sample(math::Vec2 u) const;

 private:
  /// The solid angle of a near light, as two spherical triangles.
  struct Spherical {
    sampling::SphericalTriangle first, second;
    float solid_angle;

    Spherical(const AreaLight&, math::Vec3 from);
    math::Vec3 sample(math::Vec2 u) const;
  };
  math::Rgb radiance_at(math::Vec3 point) const;

  const scene::Scene& scene_;
  const AreaLight& light_;
  math::Vec3 from_;
  float height_ = 0;    ///< over the light's plane, m; 0: nothing shows
  float move_off_ = 0;  ///< from the light to where shadow rays end, along its normal, m
  std::optional<Spherical> near_;
};

/// Holds all light that is sampled explicitly. Immutable.
class LightSet {
 public:
  /// A large sky map is summed by the workers. When they are stopped, this ends early and must not
  /// be used (see SkyLight). @param surfaces false: the scene's emitting surfaces are left out,
  /// since their texels send their light
  explicit LightSet(const scene::Scene&, const exec::Workers* workers = nullptr,
                    bool surfaces = true);

  const std::vector<AreaLight>& area() const { return area_; }
  const std::vector<scene::PunctualLight>& punctual() const { return scene_.lights; }
  /// Returns the share of each area light in the summed luminous power.
  const std::vector<float>& power_share() const { return power_share_; }
  /// Returns the table for choosing among many lights.
  const LightTable& table() const { return table_; }
  /// Returns the sky when a map gives it; null otherwise.
  const SkyLight* sky() const { return sky_ ? &*sky_ : nullptr; }
  /// Returns whether rays are sent towards bright parts of the sky.
  bool has_bright_sky() const { return sky_ && sky_->has_bright_parts(); }
  bool empty() const { return area_.empty() && scene_.lights.empty() && !scene_.has_sky(); }

  AreaLightSampler sampler_from(math::Vec3 point, const AreaLight& light,
                                Spread spread = Spread::kSolidAngle) const {
    return {scene_, light, point, spread};
  }
  /// Returns whether the longest edge is more than `ratio` times the distance of the center.
  static bool is_near(const AreaLight&, math::Vec3 from, float ratio);

 private:
  const scene::Scene& scene_;
  std::vector<AreaLight> area_;
  std::vector<float> power_share_;
  LightTable table_;
  std::optional<SkyLight> sky_;
};

/// Irradiance on a surface facing a punctual light at unit cosine, and the way to it
/// [KHR_lights_punctual: range window, spot falloff].
struct PunctualSample {
  math::Vec3 direction;                ///< unit, towards the light
  std::optional<math::Vec3> position;  ///< m; none for directional lights
  math::Rgb irradiance;                ///< lx at normal incidence

  ShadowRay shadow_ray(math::Vec3 origin) const;
};
PunctualSample sample_punctual(const scene::PunctualLight&, math::Vec3 at);

}  // namespace kiln::light
