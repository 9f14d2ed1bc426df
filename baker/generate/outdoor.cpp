#include <array>

#include "baker/generate/builder.h"
#include "baker/generate/scenes.h"

namespace kiln::generate {
namespace {

/// Returns a texel of paving: slabs of one meter with darker joints, every slab a little different.
std::array<std::uint8_t, 3> paving(std::uint32_t x, std::uint32_t y) {
  if (x % 64 < 2 || y % 64 < 2) return {88, 84, 78};
  const std::uint32_t slab = (x / 64) * 5 + (y / 64) * 3;
  const auto shade = static_cast<std::uint8_t>(slab * 37 % 40 + (x * 5 + y * 11) % 9);
  return {std::uint8_t(172 + shade), std::uint8_t(164 + shade), std::uint8_t(148 + shade)};
}

void add_lights(SceneBuilder& scene) {
  gltf::GlbLight sun;
  sun.name = "sun";
  sun.type = gltf::GlbLight::Type::kDirectional;
  sun.color = {1, 0.95f, 0.86f};
  sun.intensity = 20000;
  scene.light(sun, {0, 12, 0}, {0.48f, -0.8f, -0.36f});
  gltf::GlbLight lantern;
  lantern.name = "lantern";
  lantern.color = {1, 0.8f, 0.5f};
  lantern.intensity = 4000;
  lantern.range = 15;
  scene.light(lantern, {-5, 2.2f, -5.5f});
  gltf::GlbLight spot;
  spot.name = "spot";
  spot.type = gltf::GlbLight::Type::kSpot;
  spot.color = {0.6f, 0.75f, 1};
  spot.intensity = 30000;
  spot.inner_cone = 0.25f;
  spot.outer_cone = 0.5f;
  scene.light(spot, {5, 3.6f, 0}, {0, -0.8f, -0.6f});
}

}  // namespace

std::string sphere_on_plane(const std::string& name, std::uint32_t detail) {
  SceneBuilder scene(name);
  const auto gray = scene.material("grey", {0.5f, 0.5f, 0.5f});
  const auto orange = scene.material("orange", {0.8f, 0.4f, 0.1f});
  scene.quad("plane", gray, {-4, 0, 4}, {8, 0, 0}, {0, 0, -8});
  scene.ball("ball", orange, {0, 1, 0}, 1, detail);
  return scene.finish();
}

std::string courtyard(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto slabs = scene.material("paving", {1, 1, 1});
  scene.texture(slabs, make_png(256, paving), 4);
  const auto plaster = scene.material("plaster", {0.75f, 0.7f, 0.62f});
  const auto stone = scene.material("stone", {0.5f, 0.48f, 0.45f});
  constexpr unsigned kStanding = kAllFaces & ~kFloor;

  // The yard is 16 m x 16 m. It is open to the sky and, through a gap in the south wall, to +Z.
  scene.quad("ground", slabs, {-8, 0, 8}, {16, 0, 0}, {0, 0, -16});
  scene.solid("north wall", plaster, {{0, 0, -8.2f}, {16.8f, 4, 0.4f}}, kStanding);
  scene.solid("west wall", plaster, {{-8.2f, 0, 0}, {0.4f, 4, 16}}, kStanding);
  scene.solid("east wall", plaster, {{8.2f, 0, 0}, {0.4f, 4, 16}}, kStanding);
  scene.solid("south wall left", plaster, {{-5.2f, 0, 8.2f}, {6.4f, 4, 0.4f}}, kStanding);
  scene.solid("south wall right", plaster, {{5.2f, 0, 8.2f}, {6.4f, 4, 0.4f}}, kStanding);
  for (int i = 0; i < 5; ++i)
    scene.solid("pillar " + std::to_string(i + 1), stone,
                {{-6 + 3 * float(i), 0, -5}, {0.5f, 3, 0.5f}}, kStanding & ~kCeiling);
  scene.solid("roof", plaster, {{0, 3, -6.5f}, {15.9f, 0.2f, 2.9f}});
  scene.solid("well", stone, {{0, 0, 1.5f}, {1.6f, 0.9f, 1.6f}, math::normalize({0.8f, 0, 0.6f})},
              kStanding);
  add_lights(scene);
  return scene.finish();
}

}  // namespace kiln::generate
