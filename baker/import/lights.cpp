#include "baker/import/lights.h"

#include <cmath>
#include <string>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr float kHalfPi = math::kPi / 2;

math::Rgb color_of(const tinygltf::Light& light) {
  const float scale = static_cast<float>(light.intensity);
  if (light.color.empty()) return {scale, scale, scale};
  return math::Rgb{static_cast<float>(light.color[0]), static_cast<float>(light.color[1]),
                   static_cast<float>(light.color[2])} *
         scale;
}

/// Reads the extension's light in its node's space: at the origin, towards -Z.
Expected<scene::PunctualLight> read_light(const tinygltf::Light& light, const std::string& at) {
  scene::PunctualLight out;
  out.intensity = color_of(light);
  if (!std::isfinite(max_channel(out.intensity)))
    return gltf::invalid("is too bright", at + "/intensity");
  out.range = static_cast<float>(light.range);
  if (light.type == "directional") {
    out.type = scene::PunctualType::kDirectional;
    out.range = 0;
  } else if (light.type == "spot") {
    const double inner = light.spot.innerConeAngle, outer = light.spot.outerConeAngle;
    if (!(inner < outer) || outer > 1.0001 * kHalfPi) {
      return gltf::invalid("expected innerConeAngle < outerConeAngle <= pi/2", at + "/spot");
    }
    out.type = scene::PunctualType::kSpot;
    out.cos_inner = static_cast<float>(std::cos(inner));
    out.cos_outer = static_cast<float>(std::max(0.0, std::cos(outer)));
  } else if (light.type != "point") {
    return gltf::invalid("expected \"directional\", \"point\" or \"spot\"", at + "/type");
  }
  return out;
}

/// Returns the index of a node's light, -1 for none.
int light_of(const tinygltf::Node& node) {
  const auto extension = node.extensions.find("KHR_lights_punctual");
  if (extension == node.extensions.end() || !extension->second.Has("light")) return -1;
  return extension->second.Get("light").GetNumberAsInt();
}

// Lights of the settings --------------------------------------------------------------------------

Unexpected bad_setting(const std::string& why, const std::string& pointer) {
  return proto::fail("invalid_settings", why, "settings", pointer);
}

math::Vec3 vec(const std::array<float, 3>& a) {
  return {a[0], a[1], a[2]};
}

scene::RectLight make_rect(const proto::LightSettings& light, math::Vec3 direction,
                           math::Rgb radiance) {
  const math::Vec3 horizontal = cross({0, 1, 0}, direction);
  const math::Vec3 u = length(horizontal) > 1e-4f ? normalize(horizontal) : math::Vec3{1, 0, 0};
  const math::Vec3 v = normalize(cross(direction, u));
  scene::RectLight out;
  out.edge_u = u * light.width;
  out.edge_v = v * light.height;
  out.corner = vec(light.position) - out.edge_u * 0.5f - out.edge_v * 0.5f;
  out.radiance = radiance;
  return out;
}

scene::PunctualLight make_punctual(const proto::LightSettings& light, math::Vec3 direction,
                                   math::Rgb intensity) {
  scene::PunctualLight out;
  out.intensity = intensity;
  out.position = vec(light.position);
  out.direction = direction;
  switch (light.type) {
    case proto::LightType::kDirectional:
      out.type = scene::PunctualType::kDirectional;
      out.position = {};
      break;
    case proto::LightType::kSpot:
      out.type = scene::PunctualType::kSpot;
      out.cos_inner = std::cos(light.inner_cone_angle);
      out.cos_outer = std::max(0.f, std::cos(light.outer_cone_angle));
      out.range = light.range.value_or(0);
      break;
    default:
      out.range = light.range.value_or(0);
      break;
  }
  return out;
}

/// The brightest pixel that a sky may have, cd/m2: far above the sun's, and its square is a number.
constexpr float kMaxSkyRadiance = 1e15f;

/// Returns the brightest channel of the map; a negative number when stopped.
float brightest_of(const scene::SkyMap& map, const std::stop_token& stop) {
  float brightest = 0;
  for (std::size_t row = 0; row < map.texels.size(); row += map.width) {
    if (stop.stop_requested()) return -1;
    for (std::size_t i = row; i < row + map.width; ++i)
      brightest = std::max(brightest, max_channel(map.texels[i]));
  }
  return brightest;
}

proto::Expected<void> add_sky(scene::Scene& scene, const proto::SkySettings& sky,
                              const std::stop_token& stop) {
  scene.sky = {sky.radiance[0], sky.radiance[1], sky.radiance[2]};
  if (!sky.map) {
    scene.sky_map = {};
    return {};
  }
  scene::SkyMap& map = scene.sky_map;
  if (map.empty())
    return proto::fail("missing_file", "the scene was imported without its sky map", "settings",
                       "/sky/map");
  map.scale = sky.scale;
  map.rotation = sky.rotation * (math::kPi / 180);
  const float brightest = brightest_of(map, stop);
  if (brightest < 0) return exec::canceled();
  if (!(brightest * sky.scale <= kMaxSkyRadiance))
    return bad_setting("makes the sky map brighter than 1e15 cd/m2", "/sky/scale");
  if (!(brightest * sky.scale > 0)) map = {};
  return {};
}

proto::Expected<void> check_light(const proto::LightSettings& light, const std::string& at) {
  if (light.type != proto::LightType::kPoint && !(length(vec(light.direction)) > 0)) {
    return bad_setting("has no direction", at + "/direction");
  }
  if (light.type == proto::LightType::kSpot && !(light.inner_cone_angle < light.outer_cone_angle)) {
    return bad_setting("expected less than outer_cone_angle", at + "/inner_cone_angle");
  }
  if (light.type == proto::LightType::kRect && !(light.width > 0)) {
    return bad_setting("expected more than 0", at + "/width");
  }
  if (light.type == proto::LightType::kRect && !(light.height > 0)) {
    return bad_setting("expected more than 0", at + "/height");
  }
  return {};
}

}  // namespace

proto::Expected<void> add_punctual_lights(scene::Scene& scene, gltf::Document& document,
                                          const std::vector<PlacedNode>& placed,
                                          const files::ImportLimits& limits) {
  const auto& model = *document.model;
  for (const PlacedNode& node : placed) {
    const int index = light_of(model.nodes[node.node]);
    if (index < 0) continue;
    const std::string at =
        gltf::pointer_to("/extensions/KHR_lights_punctual/lights", static_cast<std::size_t>(index));
    auto light = read_light(model.lights[static_cast<std::size_t>(index)], at);
    if (!light) return Unexpected(light.error());
    if (scene.lights.size() >= limits.lights) {
      return gltf::over_limit("too many lights", limits.lights, "lights",
                              gltf::pointer_to("/nodes", node.node));
    }
    light->position = node.to_world.point({0, 0, 0});
    light->direction = normalize(node.to_world.direction({0, 0, -1}), {0, 0, -1});
    if (!is_finite(light->position)) {
      return gltf::invalid("the light's position is not finite",
                           gltf::pointer_to("/nodes", node.node));
    }
    if (!is_black(light->intensity)) scene.lights.push_back(*light);
  }
  return {};
}

proto::Expected<void> add_settings_lights(scene::Scene& scene, const proto::BakeSettings& settings,
                                          const std::stop_token& stop) {
  if (auto added = add_sky(scene, settings.sky, stop); !added) return added;
  for (std::size_t i = 0; i < settings.lights.size(); ++i) {
    const proto::LightSettings& light = settings.lights[i];
    if (auto fine = check_light(light, gltf::pointer_to("/lights", i)); !fine) return fine;
    const math::Rgb emitted =
        math::Rgb{light.color[0], light.color[1], light.color[2]} * light.intensity;
    if (is_black(emitted)) continue;
    const math::Vec3 direction = normalize(vec(light.direction));
    if (light.type == proto::LightType::kRect) {
      scene.rect_lights.push_back(make_rect(light, direction, emitted));
    } else {
      scene.lights.push_back(make_punctual(light, direction, emitted));
    }
  }
  return {};
}

proto::Expected<void> require_light(const scene::Scene& scene, bool emissive,
                                    const proto::BakeSettings& settings) {
  if (emissive || settings.allow_dark || scene.has_sky() || !scene.lights.empty() ||
      !scene.rect_lights.empty()) {
    return {};
  }
  proto::Error error{
      "no_light", "nothing in the scene emits light; add lights or a sky, or set allow_dark", {}};
  error.details = {
      {"settings", "/lights", "is empty, and the scene has neither lights nor emissive surfaces"},
      {"settings", "/sky/radiance", "is black, and there is no sky map that gives light"}};
  return Unexpected(error);
}

}  // namespace kiln::import
