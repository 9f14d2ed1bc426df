#include <string>

#include "baker/generate/scenes.h"
#include "baker/generate/solids.h"
#include "baker/generate/wrap.h"

// A nursery: a bear, bricks, balls. Lengths are in meters.
namespace kiln::generate {
namespace {

using math::Vec3;

/// A bear that sits on y = 0 and looks along +Z, 62 cm tall.
float bear(Vec3 p, float) {
  float d = ellipsoid(p, {0, 0.17f, 0}, {0.15f, 0.18f, 0.135f});
  d = join(d, ellipsoid(p, {0, 0.43f, 0.01f}, {0.145f, 0.13f, 0.125f}), 0.04f);  // head
  d = join(d, ellipsoid(p, {0, 0.395f, 0.12f}, {0.07f, 0.052f, 0.06f}), 0.03f);  // snout
  for (const float side : {-1.f, 1.f}) {
    const Vec3 q{p.x * side, p.y, p.z};
    d = join(d, ellipsoid(q, {0.12f, 0.55f, 0}, {0.058f, 0.062f, 0.035f}), 0.02f);
    d = join(d, rod(q, {0.12f, 0.27f, 0.03f}, {0.25f, 0.20f, 0.14f}, 0.058f, 0.05f), 0.03f);
    d = join(d, rod(q, {0.10f, 0.075f, 0.05f}, {0.17f, 0.068f, 0.30f}, 0.075f, 0.062f), 0.03f);
    d = join(d, ellipsoid(q, {0.175f, 0.085f, 0.335f}, {0.062f, 0.085f, 0.04f}), 0.02f);
  }
  return d;
}

/// Adds the bear, which has 204 `cells`^2 triangles, and its eyes and nose: 3 * 48 more.
void add_bear(SceneBuilder& scene, std::int32_t fur, std::int32_t black, Vec3 foot,
              std::uint32_t cells) {
  Cage cage;
  cage.cube_m = 0.1f;
  cage.boxes = {{{-1, 0, -1}, {1, 5, 1}},                            // body and head
                {{-1, 3, 1}, {1, 4, 2}},                             // snout
                {{-2, 4, -1}, {-1, 5, 0}}, {{1, 4, -1}, {2, 5, 0}},  // ears
                {{-3, 2, 0}, {-1, 3, 1}},  {{1, 2, 0}, {3, 3, 1}},   // arms
                {{-2, 0, 0}, {-1, 1, 3}},  {{1, 0, 0}, {2, 1, 3}}};  // legs
  cage.place = [=](Vec3 l) {
    Vec3 p{0.085f * l.x, 0.105f * l.y + 0.02f, 0.085f * l.z};
    const float beside = std::max(0.f, std::abs(l.x) - 1);
    if (l.y >= 4) p.y += 0.03f * beside, p.z += 0.03f * beside;
    if (l.y >= 2 && l.y <= 3) p.y -= 0.02f * beside, p.z += 0.04f * beside;
    if (l.y <= 1 && beside > 0) p.z += 0.03f, p.x *= 1 + 0.1f * std::max(0.f, l.z);
    return foot + p;
  };
  add_wrapped(
      scene, {"bear", fur}, cage, [=](Vec3 p, float coarse) { return bear(p - foot, coarse); },
      cells);
  for (const float x : {-0.055f, 0.055f})
    add_ellipsoid(scene, {"eyes and nose", black}, foot + Vec3{x, 0.465f, 0.128f},
                  {0.016f, 0.018f, 0.014f}, {2, 2, 2});
  add_ellipsoid(scene, {"eyes and nose", black}, foot + Vec3{0, 0.415f, 0.178f},
                {0.024f, 0.016f, 0.016f}, {2, 2, 2});
}

/// Adds a bottle with a closed foot and mouth.
void add_bottle(SceneBuilder& scene, const Part& part, Vec3 foot) {
  add_lathe(scene, part, foot,
            {{0.048f, 0}, {0.05f, 0.115f}, {0.022f, 0.16f}, {0.019f, 0.20f}, {0.024f, 0.21f}}, 12,
            Ends::kBoth);
}

}  // namespace

std::string toys(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto wall = scene.material("wall", {0.7f, 0.7f, 0.66f});
  const auto floor = scene.material("floor", {0.55f, 0.42f, 0.28f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {26, 24, 20});
  const auto red = scene.material("red", {0.65f, 0.08f, 0.06f});
  const auto blue = scene.material("blue", {0.1f, 0.2f, 0.6f});
  const auto yellow = scene.material("yellow", {0.75f, 0.6f, 0.1f});
  const auto green = scene.material("green", {0.12f, 0.45f, 0.15f});

  const Box corner{{0, 0, 0}, {2.4f, 1.8f, 2}};
  scene.room("room", floor, corner, kFloor);
  scene.room("room", wall, corner, kBack | kLeft);
  scene.quad("lamp", lamp, {-0.2f, 1.7f, 0.1f}, {0.5f, 0, 0}, {0, 0, 0.5f});
  add_bear(scene, scene.material("fur", {0.45f, 0.26f, 0.12f}),
           scene.material("black", {0.03f, 0.03f, 0.03f}), {-0.15f, 0, -0.35f}, 3);
  add_ellipsoid(scene, {"ball", red}, {0.62f, 0.19f, 0.15f}, {0.19f, 0.19f, 0.19f}, {8, 8, 8});
  add_ellipsoid(scene, {"small ball", blue}, {-0.75f, 0.11f, 0.3f}, {0.11f, 0.11f, 0.11f},
                {5, 5, 5});
  struct Brick {
    std::int32_t material;
    Vec3 bottom;
    float side;
    Vec3 axis_x;
  };
  const Brick bricks[] = {{yellow, {0.55f, 0, -0.55f}, 0.22f, {0.96f, 0, 0.28f}},
                          {green, {0.82f, 0, -0.45f}, 0.22f, {0.8f, 0, -0.6f}},
                          {blue, {0.67f, 0.22f, -0.51f}, 0.20f, {1, 0, 0}},
                          {red, {0.68f, 0.42f, -0.51f}, 0.16f, {0.8f, 0, 0.6f}},
                          {red, {-0.8f, 0, -0.55f}, 0.24f, {0.6f, 0, 0.8f}},
                          {yellow, {-0.82f, 0.24f, -0.56f}, 0.18f, {0.96f, 0, -0.28f}},
                          {blue, {-0.15f, 0, 0.62f}, 0.14f, {0.6f, 0, -0.8f}}};
  for (const Brick& b : bricks)
    add_box(scene, {"bricks", b.material}, {b.bottom, {b.side, b.side, b.side}, b.axis_x},
            kAllFaces & ~kFloor);
  // A cone of rings.
  for (int i = 0; i < 3; ++i)
    add_torus(scene,
              {"rings", i == 0   ? blue
                        : i == 1 ? yellow
                                 : red},
              {-0.45f, 0.045f + 0.085f * float(i), 0.55f}, {}, 0.11f - 0.025f * float(i), 0.045f,
              12 - 2 * std::uint32_t(i), 5);
  return scene.finish();
}

std::string teddy(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto cloth = scene.material("cloth", {0.6f, 0.6f, 0.62f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {14, 12, 10});
  scene.quad("floor", cloth, {-0.9f, 0, 0.9f}, {1.8f, 0, 0}, {0, 0, -1.8f});
  scene.quad("lamp", lamp, {0.25f, 1.4f, 0.05f}, {0.4f, 0, 0}, {0, 0, 0.4f});
  add_bear(scene, scene.material("fur", {0.5f, 0.3f, 0.14f}),
           scene.material("black", {0.03f, 0.03f, 0.03f}), {0, 0, -0.15f}, 4);
  add_bottle(scene, {"bottle", scene.material("milk", {0.75f, 0.72f, 0.62f})},
             {0.36f, 0.001f, 0.12f});
  return scene.finish();
}

}  // namespace kiln::generate
