#include "baker/generate/builder.h"
#include "baker/generate/scenes.h"

// Scenes whose light is known in closed form.
namespace kiln::generate {
namespace {

std::string furnace(const std::string& name, float albedo) {
  SceneBuilder scene(name);
  const auto wall = scene.material("wall", {albedo, albedo, albedo}, {1, 1, 1});
  scene.room("box", wall, {{0, 0, 0}, {4, 2, 3}});
  return scene.finish();
}

constexpr math::Vec3 kPlaneCorner{-2, 0, 2}, kPlaneU{4, 0, 0}, kPlaneV{0, 0, -4};

std::int32_t add_plane(SceneBuilder& scene) {
  const auto gray = scene.material("grey", {0.5f, 0.5f, 0.5f});
  scene.quad("plane", gray, kPlaneCorner, kPlaneU, kPlaneV);
  return gray;
}

}  // namespace

std::string furnace_50(const std::string& name, std::uint32_t) {
  return furnace(name, 0.5f);
}
std::string furnace_90(const std::string& name, std::uint32_t) {
  return furnace(name, 0.9f);
}

std::string plates(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto gray = scene.material("grey", {0.5f, 0.5f, 0.5f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {1, 1, 1});
  scene.quad("receiver", gray, {0, 0, 1}, {1, 0, 0}, {0, 0, -1});
  scene.quad("emitter", lamp, {0, 1, 0}, {1, 0, 0}, {0, 0, 1});
  return scene.finish();
}

std::string plates_perpendicular(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto gray = scene.material("grey", {0.5f, 0.5f, 0.5f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {1, 1, 1});
  scene.quad("receiver", gray, {0, 0, 1}, {1, 0, 0}, {0, 0, -1});
  scene.quad("emitter", lamp, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  return scene.finish();
}

std::string rect_light(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  add_plane(scene);
  const auto lamp = scene.material("lamp", {0, 0, 0}, {10, 10, 10});
  scene.quad("lamp", lamp, {-0.5f, 1, -0.5f}, {1, 0, 0}, {0, 0, 1});
  return scene.finish();
}

std::string color_box(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto white = scene.material("white", {0.8f, 0.8f, 0.8f});
  const auto red = scene.material("red", {0.7f, 0.1f, 0.1f});
  const auto blue = scene.material("blue", {0.1f, 0.2f, 0.7f});
  const auto lamp = scene.material("lamp", {0.5f, 0.5f, 0.5f}, {20, 18, 15});
  const Box box{{0, 0, 0}, {3, 2.5f, 4}};
  scene.room("box", white, box, kFloor | kBack | kFront);
  scene.room("box", red, box, kLeft);
  scene.room("box", blue, box, kRight);
  scene.room("lamp", lamp, box, kCeiling);
  return scene.finish();
}

std::string sealed(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto white = scene.material("white", {0.8f, 0.8f, 0.8f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {50, 50, 50});
  scene.room("inside", white, {{0, 0.1f, 0}, {2, 2, 2}});
  scene.solid("outside", white, {{0, 0, 0}, {2.2f, 2.2f, 2.2f}});
  scene.quad("lamp", lamp, {-0.5f, 3.5f, -0.5f}, {1, 0, 0}, {0, 0, 1});
  gltf::GlbLight point;
  point.name = "point";
  point.intensity = 100;
  scene.light(point, {2, 1.5f, 2});
  return scene.finish();
}

std::string plane_point(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  add_plane(scene);
  gltf::GlbLight light;
  light.name = "point";
  light.intensity = 100;
  scene.light(light, {0, 1, 0});
  return scene.finish();
}

std::string plane_spot(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  add_plane(scene);
  gltf::GlbLight light;
  light.name = "spot";
  light.type = gltf::GlbLight::Type::kSpot;
  light.intensity = 100;
  light.inner_cone = 0.3f;
  light.outer_cone = 0.6f;
  scene.light(light, {0, 2, 0}, {0, -1, 0});
  return scene.finish();
}

std::string plane_sun(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  add_plane(scene);
  gltf::GlbLight light;
  light.name = "sun";
  light.type = gltf::GlbLight::Type::kDirectional;
  light.intensity = 1000;
  scene.light(light, {0, 5, 0}, {0.6f, -0.8f, 0});
  return scene.finish();
}

std::string tilted_plane(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto gray = scene.material("grey", {0.5f, 0.5f, 0.5f});
  scene.quad("plane", gray, {-0.5f, 0, 0}, {1, 0, 0}, {0, 0.6f, -0.8f});
  return scene.finish();
}

}  // namespace kiln::generate
