// Lights of the glTF and of the settings, and what happens when there are none.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/import/import_helpers.h"

namespace kiln::import {
namespace {

/// A triangle, and a light under a node with the given transform.
test::GltfBuilder with_light(nlohmann::json light, nlohmann::json node = nlohmann::json::object()) {
  GltfBuilder b = test::triangle_builder();
  b.json["extensionsUsed"] = {"KHR_lights_punctual"};
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {std::move(light)};
  node["extensions"]["KHR_lights_punctual"]["light"] = 0;
  b.node(std::move(node));
  return b;
}

scene::PunctualLight only_light(const GltfBuilder& b) {
  const scene::Scene scene = imported(b.glb(), proto::BakeSettings{});  // the light is all it has
  EXPECT_EQ(scene.lights.size(), 1u);
  return scene.lights.empty() ? scene::PunctualLight{} : scene.lights[0];
}

TEST(Lights, Directional) {
  const double h = std::sqrt(0.5);  // a quarter turn about X: -Z becomes +Y
  const auto light = only_light(with_light(
      {{"type", "directional"}, {"intensity", 1000}, {"color", {1, 0.5, 0}}, {"range", 4}},
      {{"rotation", {h, 0, 0, h}}}));
  EXPECT_EQ(light.type, scene::PunctualType::kDirectional);
  EXPECT_EQ(light.intensity, (math::Rgb{1000, 500, 0}));
  expect_near(light.direction, {0, 1, 0}, 1e-6f);
  EXPECT_EQ(light.range, 0);  // has no meaning for a directional light
}

TEST(Lights, PointWithDefaults) {
  const auto light = only_light(
      with_light({{"type", "point"}}, {{"translation", {1, 2, 3}}, {"scale", {5, 5, 5}}}));
  EXPECT_EQ(light.type, scene::PunctualType::kPoint);
  EXPECT_EQ(light.intensity, (math::Rgb{1, 1, 1}));
  EXPECT_EQ(light.position, (math::Vec3{1, 2, 3}));
  EXPECT_EQ(light.range, 0);
}

TEST(Lights, SpotUnderAScaledParent) {
  GltfBuilder b = with_light({{"type", "spot"},
                              {"intensity", 20},
                              {"range", 3},
                              {"spot", {{"innerConeAngle", 0.25}, {"outerConeAngle", 0.5}}}},
                             {{"translation", {0, 1, 0}}});
  b.node({{"children", {1}}, {"scale", {2, 2, 2}}});
  const auto light = only_light(b);
  EXPECT_EQ(light.type, scene::PunctualType::kSpot);
  EXPECT_EQ(light.position, (math::Vec3{0, 2, 0}));
  expect_near(light.direction, {0, 0, -1});
  EXPECT_EQ(light.range, 3);  // scale does not touch it
  EXPECT_FLOAT_EQ(light.cos_inner, std::cos(0.25f));
  EXPECT_FLOAT_EQ(light.cos_outer, std::cos(0.5f));
}

TEST(Lights, SpotDefaults) {
  const auto light = only_light(with_light({{"type", "spot"}, {"spot", nlohmann::json::object()}}));
  EXPECT_FLOAT_EQ(light.cos_inner, 1);
  EXPECT_FLOAT_EQ(light.cos_outer, static_cast<float>(std::numbers::sqrt2 / 2));
}

TEST(Lights, WrongLightsAreErrors) {
  const auto expect_error = [](nlohmann::json light, const std::string& pointer) {
    const auto scene = import_bytes(with_light(std::move(light)).glb());
    ASSERT_FALSE(scene);
    EXPECT_EQ(scene.error().code, "invalid_scene");
    EXPECT_EQ(scene.error().details.at(0).pointer,
              "/extensions/KHR_lights_punctual/lights/0" + pointer);
  };
  expect_error({{"type", "laser"}}, "/type");
  expect_error({{"type", "point"}, {"intensity", -1}}, "/intensity");
  expect_error({{"type", "spot"}, {"spot", {{"innerConeAngle", 1}, {"outerConeAngle", 0.5}}}},
               "/spot");
  expect_error({{"type", "spot"}, {"spot", {{"outerConeAngle", 2}}}}, "/spot");
  expect_error({{"intensity", 1}}, "");
}

TEST(Lights, LightsOutsideTheSceneDoNotShine) {
  GltfBuilder b = with_light({{"type", "point"}});
  b.json["scenes"] = {{{"nodes", {0}}}};
  const auto scene = import_bytes(b.glb(), proto::BakeSettings{});
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, "no_light");
}

TEST(Lights, TooManyLights) {
  GltfBuilder b = with_light({{"type", "point"}});
  files::ImportLimits limits;
  limits.lights = 0;
  EXPECT_EQ(import_bytes(b.glb(), dark(), limits).error().code, "limit_exceeded");
}

// Settings ----------------------------------------------------------------------------------------

TEST(SettingsLights, NoLightNamesTheSettingsThatHelp) {
  const Upload upload(test::triangle_builder().glb());
  for (const auto& error :
       {check_scene(upload.files, {}).error(), import_scene(upload.files, {}).error()}) {
    EXPECT_EQ(error.code, "no_light");
    ASSERT_EQ(error.details.size(), 2u);
    EXPECT_EQ(error.details[0].source, "settings");
    EXPECT_EQ(error.details[0].pointer, "/lights");
    EXPECT_EQ(error.details[1].pointer, "/sky/radiance");
  }
  EXPECT_TRUE(check_scene(upload.files, dark()));
}

TEST(SettingsLights, SkyIsALight) {
  proto::BakeSettings settings;
  settings.sky.radiance = {0, 0, 100};
  EXPECT_EQ(imported(test::triangle_builder().glb(), settings).sky, (math::Rgb{0, 0, 100}));
}

TEST(SettingsLights, EmissiveSurfaceIsALight) {
  GltfBuilder b = test::triangle_builder();
  b.material({{"emissiveFactor", {1, 1, 1}}});
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  const Upload upload(b.glb());
  EXPECT_TRUE(check_scene(upload.files, {}));
  EXPECT_TRUE(import_scene(upload.files, {}));
  b.json["materials"][0]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = 0;
  const Upload off(b.glb());
  EXPECT_EQ(check_scene(off.files, {}).error().code, "no_light");
}

TEST(SettingsLights, RectangleIsCenteredAndFacesItsDirection) {
  for (const std::array<float, 3>& direction : {std::array<float, 3>{0, -1, 0},
                                                {0, 2, 0},
                                                {1, 0, 0},
                                                {0, 0, -3},
                                                {1, 1, 1},
                                                {-1, 0.5f, 2}}) {
    proto::BakeSettings settings;
    proto::LightSettings light;
    light.type = proto::LightType::kRect;
    light.position = {1, 2, 3};
    light.direction = direction;
    light.width = 2;
    light.height = 0.5f;
    light.intensity = 30;
    light.color = {1, 0, 0.5f};
    settings.lights = {light};
    const scene::Scene scene = imported(test::triangle_builder().glb(), settings);
    ASSERT_EQ(scene.rect_lights.size(), 1u);
    const scene::RectLight& r = scene.rect_lights[0];
    expect_near(r.corner + r.edge_u * 0.5f + r.edge_v * 0.5f, {1, 2, 3}, 1e-6f);
    expect_near(cross(r.edge_u, r.edge_v),
                math::normalize({direction[0], direction[1], direction[2]}), 1e-6f);
    EXPECT_NEAR(length(r.edge_u), 2, 1e-6f);
    EXPECT_NEAR(length(r.edge_v), 0.5f, 1e-6f);
    EXPECT_NEAR(r.edge_u.y, 0, 1e-6f);  // the width is horizontal
    EXPECT_EQ(r.radiance, (math::Rgb{30, 0, 15}));
  }
}

TEST(SettingsLights, PunctualLightsOfTheSettings) {
  proto::BakeSettings settings;
  proto::LightSettings sun, spot;
  sun.type = proto::LightType::kDirectional;
  sun.direction = {0, -2, 0};
  sun.intensity = 500;
  spot.type = proto::LightType::kSpot;
  spot.position = {0, 3, 0};
  spot.range = 7.f;
  settings.lights = {sun, spot};
  const scene::Scene scene = imported(test::triangle_builder().glb(), settings);
  ASSERT_EQ(scene.lights.size(), 2u);
  EXPECT_EQ(scene.lights[0].direction, (math::Vec3{0, -1, 0}));
  EXPECT_EQ(scene.lights[0].intensity, (math::Rgb{500, 500, 500}));
  EXPECT_EQ(scene.lights[1].position, (math::Vec3{0, 3, 0}));
  EXPECT_EQ(scene.lights[1].range, 7);
  EXPECT_FLOAT_EQ(scene.lights[1].cos_outer, static_cast<float>(std::numbers::sqrt2 / 2));
}

TEST(SettingsLights, LightWithoutDirectionIsAnError) {
  proto::BakeSettings settings;
  proto::LightSettings sun;
  sun.type = proto::LightType::kDirectional;
  sun.direction = {0, 0, 0};
  settings.lights = {proto::LightSettings{}, sun};
  const auto scene = import_bytes(test::triangle_builder().glb(), settings);
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, "invalid_settings");
  EXPECT_EQ(scene.error().details.at(0).pointer, "/lights/1/direction");
}

}  // namespace
}  // namespace kiln::import
