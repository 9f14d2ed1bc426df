#include <array>

#include "baker/generate/builder.h"
#include "baker/generate/scenes.h"

namespace kiln::generate {
namespace {

std::array<std::uint8_t, 3> checker(std::uint32_t x, std::uint32_t y) {
  const bool light = ((x / 32) + (y / 32)) % 2 == 0;
  const auto grain = static_cast<std::uint8_t>((x * 7 + y * 13) % 16);
  if (light)
    return {std::uint8_t(214 - grain), std::uint8_t(206 - grain), std::uint8_t(188 - grain)};
  return {std::uint8_t(96 + grain), std::uint8_t(72 + grain), std::uint8_t(52 + grain)};
}

std::array<std::uint8_t, 3> stripes(std::uint32_t x, std::uint32_t) {
  return (x / 8) % 2 == 0 ? std::array<std::uint8_t, 3>{188, 200, 214}
                          : std::array<std::uint8_t, 3>{168, 184, 204};
}

/// Returns a texel of four colored panes in a dark frame.
std::array<std::uint8_t, 3> panes(std::uint32_t x, std::uint32_t y) {
  if (x % 32 < 3 || y % 32 < 3 || x % 32 > 28 || y % 32 > 28) return {0, 0, 0};
  constexpr std::array<std::array<std::uint8_t, 3>, 4> kColors{
      {{255, 96, 64}, {64, 200, 255}, {255, 220, 96}, {120, 255, 120}}};
  return kColors[(y / 32) * 2 + x / 32];
}

/// A small linear congruential generator. It suffices because positions only need to look
/// scattered.
class Scatter {
 public:
  float next() {
    state_ = state_ * 1664525u + 1013904223u;
    return float(state_ >> 8) / float(1u << 24);
  }

 private:
  std::uint32_t state_ = 12345;
};

}  // namespace

std::string room_textured(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto floor = scene.material("tiles", {1, 1, 1});
  scene.texture(floor, make_png(128, checker), 2);
  const auto wall = scene.material("wallpaper", {0.9f, 0.9f, 0.9f});
  scene.texture(wall, make_png(64, stripes), 1);
  const auto plaster = scene.material("plaster", {0.8f, 0.8f, 0.78f});
  const auto picture = scene.material("picture", {0, 0, 0}, {400, 400, 400});
  scene.texture(picture, make_png(64, panes), 1);

  const Box box{{0, 0, 0}, {6, 3, 4}};
  scene.room("room", floor, box, kFloor);
  scene.room("room", plaster, box, kCeiling);
  scene.room("room", wall, box, kLeft | kRight | kBack | kFront);
  // The picture is one square meter, so its texture fills it once.
  scene.quad("picture", picture, {-0.5f, 1, -1.98f}, {1, 0, 0}, {0, 1, 0});
  scene.solid("table", plaster, {{1.2f, 0.7f, 0.3f}, {1.4f, 0.05f, 0.8f}});
  scene.solid("chest", plaster,
              {{-1.9f, 0, 0.9f}, {0.9f, 0.6f, 0.6f}, math::normalize({0.9f, 0, 0.4f})},
              kAllFaces & ~kFloor);
  return scene.finish();
}

std::string many_lights(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto gray = scene.material("grey", {0.6f, 0.6f, 0.6f});
  std::array<std::int32_t, 8> glow{};
  for (std::size_t i = 0; i < glow.size(); ++i) {
    const math::Rgb tint{(i & 1) != 0 ? 1.f : 0.25f, (i & 2) != 0 ? 1.f : 0.25f,
                         (i & 4) != 0 ? 1.f : 0.25f};
    glow[i] = scene.material("glow " + std::to_string(i), {0, 0, 0}, tint * 800);
  }
  scene.room("hall", gray, {{0, 0, 0}, {12, 4, 8}});
  for (int i = 0; i < 6; ++i)
    scene.solid("column " + std::to_string(i + 1), gray,
                {{-4 + 4 * float(i % 3), 0, i < 3 ? -1.8f : 1.8f}, {0.5f, 3, 0.5f}},
                kAllFaces & ~kFloor);
  Scatter scatter;
  for (int i = 0; i < 200; ++i) {
    const float x = -5.8f + 11.4f * scatter.next(), z = -3.8f + 7.4f * scatter.next();
    const float y = 3.2f + 0.7f * scatter.next(), side = 0.06f + 0.1f * scatter.next();
    const auto material = glow[std::size_t(i) % glow.size()];
    if (i % 2 == 0)
      scene.quad("lights", material, {x, y, z}, {side, 0, 0}, {0, 0, side});
    else
      scene.triangle("lights", material, {x, y, z}, {side, 0, 0}, {0, 0, side});
  }
  return scene.finish();
}

}  // namespace kiln::generate
