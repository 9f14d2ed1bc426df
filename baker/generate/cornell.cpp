#include "baker/generate/scenes.h"
#include "baker/generate/shapes.h"
#include "baker/generate/statue.h"

// The Cornell box and what is put into it.
namespace kiln::generate {
namespace {

// The box of Goral, Torrance, Greenberg and Battaile in Cornell's measured version, in meters. The
// floor's middle is the origin, the open side faces +Z, and red is on the left.
constexpr math::Vec3 kCornellSize{5.528f, 5.488f, 5.592f};

struct CornellColors {
  std::int32_t white, red, green, lamp;
};

CornellColors cornell_room(SceneBuilder& scene, math::Rgb lamp) {
  const CornellColors c{scene.material("white", {0.725f, 0.71f, 0.68f}),
                        scene.material("red", {0.63f, 0.065f, 0.05f}),
                        scene.material("green", {0.14f, 0.45f, 0.091f}),
                        scene.material("lamp", {0, 0, 0}, lamp)};
  const Box box{{0, 0, 0}, kCornellSize};
  scene.room("room", c.white, box, kFloor | kCeiling | kBack);
  scene.room("room", c.red, box, kLeft);
  scene.room("room", c.green, box, kRight);
  return c;
}

/// Hangs a lamp one centimeter under the ceiling. It faces down only.
void add_lamp(SceneBuilder& scene, std::int32_t material, float x, float width, float depth) {
  scene.quad("lamp", material, {x - width / 2, 5.478f, -depth / 2}, {width, 0, 0}, {0, 0, depth});
}

CornellColors cornell_box(SceneBuilder& scene) {
  const CornellColors c = cornell_room(scene, {17, 12, 4});
  add_lamp(scene, c.lamp, 0, 1.3f, 1.05f);
  return c;
}

/// A smooth periodic wave. It uses no transcendental functions, because their last bits vary
/// between machines.
float wave(float x) {
  const float turn = x - 2 * std::floor(x / 2 + 0.5f);  // [-1, 1)
  return 4 * turn * (1 - std::abs(turn));
}

float bumps(math::Vec3 d) {
  return 1 + 0.10f * wave(2 * d.x + 0.3f) * wave(2 * d.y) * wave(2 * d.z + 0.5f) +
         0.03f * wave(7 * d.x) * wave(7 * d.y + 0.25f) + 0.02f * wave(9 * d.z) * wave(8 * d.y);
}

constexpr unsigned kUpright = kAllFaces & ~kFloor;  // what stands on the floor is dark below

}  // namespace

std::string cornell(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const CornellColors c = cornell_box(scene);
  scene.solid("short block", c.white,
              {{0.914f, 0, 1.106f}, {1.65f, 1.65f, 1.65f}, math::normalize({0.956f, 0, 0.293f})},
              kUpright);
  scene.solid("tall block", c.white,
              {{-0.921f, 0, -0.718f}, {1.65f, 3.3f, 1.65f}, math::normalize({0.955f, 0, -0.296f})},
              kUpright);
  return scene.finish();
}

std::string cornell_shelves(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const CornellColors c = cornell_box(scene);
  // Each shelf spans two thirds of the room. Shelves alternate between the left and the right wall,
  // 2 cm off it.
  for (int i = 0; i < 4; ++i) {
    const float side = i % 2 == 0 ? -1.f : 1.f;
    const float y = 1 + 1.05f * float(i);
    scene.solid("shelf " + std::to_string(i + 1), c.white,
                {{side * (kCornellSize.x / 2 - 1.92f), y, -0.2f}, {3.8f, 0.04f, 4.8f}});
  }
  return scene.finish();
}

std::string bumpy_ball(const std::string& name, std::uint32_t detail) {
  SceneBuilder scene(name);
  const CornellColors c = cornell_box(scene);
  scene.solid("plinth", c.white, {{0, 0, 0}, {1.8f, 0.8f, 1.8f}}, kUpright);
  scene.ball("statue", c.white, {0, 2.2f, 0}, 1.25f, detail, bumps);
  return scene.finish();
}

std::string cornell_30(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const CornellColors c = cornell_box(scene);
  // Without its side at the wall, the short block brings the triangles, lamp and all, to thirty.
  add_box(scene, {"short block", c.white},
          {{kCornellSize.x / 2 - 0.825f, 0, 0.95f}, {1.65f, 1.65f, 1.65f}}, kUpright & ~kRight);
  add_box(scene, {"tall block", c.white},
          {{-0.921f, 0, -0.718f}, {1.65f, 3.3f, 1.65f}, math::normalize({0.955f, 0, -0.296f})},
          kUpright);
  return scene.finish();
}

std::string cornell_lucy(const std::string& name, std::uint32_t detail) {
  SceneBuilder scene(name);
  const CornellColors c = cornell_room(scene, {9, 8, 6.5f});
  add_lamp(scene, c.lamp, 0, 3.2f, 3.2f);
  add_box(scene, {"plinth", c.white}, {{0, 0, 0}, {1.9f, 0.2f, 1.9f}}, kUpright);
  add_box(scene, {"plinth", c.white}, {{0, 0.2f, 0}, {1.5f, 0.4f, 1.5f}}, kUpright);
  // The hem of the robe is sunk into the plinth by a millimeter.
  add_statue(scene, {"statue", scene.material("marble", {0.78f, 0.76f, 0.72f}), 2},
             {0, 0.599f, 0.1f}, detail);
  return scene.finish();
}

std::string cornell_geom(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const CornellColors c = cornell_room(scene, {90, 75, 50});
  add_lamp(scene, c.lamp, 0, 3.2f, 0.05f);
  const auto blue = scene.material("blue", {0.12f, 0.22f, 0.6f});
  const auto yellow = scene.material("yellow", {0.7f, 0.55f, 0.1f});
  const auto gray = scene.material("gray", {0.4f, 0.4f, 0.4f});

  add_box(scene, {"box", c.white},
          {{1.35f, 0, -1.3f}, {1.3f, 2.6f, 1.3f}, math::normalize({0.94f, 0, -0.34f})}, kUpright);
  add_lathe(scene, {"cylinder", gray}, {-1.6f, 0, -1.3f}, {{0.65f, 0}, {0.65f, 1.9f}}, 48,
            Ends::kTop);
  scene.ball("sphere", blue, {-1.6f, 2.6f, -1.3f}, 0.7f, 16);
  const auto ring = [](math::Vec3 middle, float radius, int points) {
    std::vector<math::Vec3> r;
    for (int i = 0; i < points; ++i)
      r.push_back(middle + around_y(double(i) / double(points)) * radius);
    return r;
  };
  add_fan(scene, {"cone", yellow}, ring({0.1f, 0, 0.3f}, 0.8f, 48), {0.1f, 1.35f, 0.3f});
  add_pyramid(scene, {"pyramid", c.white}, {-1.5f, 0, 1.2f}, {1.3f, 1.1f, 1.3f},
              math::normalize({0.8f, 0, 0.6f}), false);
  add_torus(scene, {"torus", blue}, {1.5f, 0.22f, 1.1f}, {}, 0.6f, 0.22f, 48, 20);
  return scene.finish();
}

std::string cornell_layers(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto white = scene.material("white", {0.725f, 0.71f, 0.68f});
  const auto red = scene.material("red", {0.63f, 0.065f, 0.05f});
  const auto green = scene.material("green", {0.14f, 0.45f, 0.091f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {25, 20, 12});

  // The wedge tapers from 1.4 m on the floor to 10 cm under the ceiling. Each half of the room ends
  // at its foot and at its top, so that no texel has a share in both halves.
  const float x = kCornellSize.x / 2, y = kCornellSize.y, z = kCornellSize.z / 2;
  constexpr float kFoot = 0.7f, kTop = 0.05f;
  for (const float side : {-1.f, 1.f}) {
    const std::string node = side < 0 ? "lit half" : "dark half";
    const auto corners = [&](std::int32_t material, math::Vec3 a, math::Vec3 b, math::Vec3 c,
                             math::Vec3 d) {
      for (math::Vec3* p : {&a, &b, &c, &d}) p->x *= side;
      if (side > 0)
        add_corners(scene, {node, material}, a, b, c, d);
      else
        add_corners(scene, {node, material}, d, c, b, a);
    };
    corners(white, {kFoot, 0, z}, {x, 0, z}, {x, 0, -z}, {kFoot, 0, -z});   // floor
    corners(white, {kTop, y, -z}, {x, y, -z}, {x, y, z}, {kTop, y, z});     // ceiling
    corners(white, {kFoot, 0, -z}, {x, 0, -z}, {x, y, -z}, {kTop, y, -z});  // back
    corners(side < 0 ? red : green, {x, 0, -z}, {x, 0, z}, {x, y, z}, {x, y, -z});
    corners(white, {kFoot, 0, z}, {kFoot, 0, -z}, {kTop, y, -z}, {kTop, y, z});  // wedge
  }
  add_corners(scene, {"wedge's front", white}, {-kFoot, 0, z}, {kFoot, 0, z}, {kTop, y, z},
              {-kTop, y, z});
  scene.quad("lamp", lamp, {-2.0f, 5.478f, -0.5f}, {1, 0, 0}, {0, 0, 1});
  // Two layers under the lamp, for soft shadows, and one in the dark.
  add_box(scene, {"upper layer", white}, {{-1.9f, 3.3f, -0.6f}, {1.2f, 0.1f, 2.4f}});
  add_box(scene, {"lower layer", white}, {{-1.6f, 1.5f, 0.5f}, {1.0f, 0.1f, 2.4f}});
  add_box(scene, {"dark layer", white}, {{1.7f, 1.8f, 0}, {1.2f, 0.1f, 2.4f}});
  return scene.finish();
}

std::string spheres_and_cube(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto gray = scene.material("gray", {0.6f, 0.6f, 0.6f});
  const auto green = scene.material("green", {0.2f, 0.5f, 0.22f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {10, 10, 9});
  // The back wall is green above a gray dado.
  const Box box{{0, 0, 0}, {4, 4, 4}};
  scene.room("room", gray, box, kFloor | kCeiling);
  scene.room("room", green, box, kLeft | kRight);
  scene.quad("room", gray, {-2, 0, -2}, {4, 0, 0}, {0, 1, 0});
  scene.quad("room", green, {-2, 1, -2}, {4, 0, 0}, {0, 3, 0});
  scene.quad("lamp", lamp, {-0.5f, 3.99f, -0.5f}, {1, 0, 0}, {0, 0, 1});
  add_ellipsoid(scene, {"red sphere", scene.material("red", {0.65f, 0.08f, 0.06f})},
                {-0.85f, 1.2f, -0.3f}, {0.75f, 0.75f, 0.75f}, {5, 4, 5});
  add_ellipsoid(scene, {"yellow sphere", scene.material("yellow", {0.75f, 0.65f, 0.1f})},
                {0.8f, 2.5f, -0.5f}, {0.6f, 0.6f, 0.6f}, {4, 4, 4});
  add_box(scene, {"cube", gray},
          {{0.75f, 0.5f, 0.5f}, {0.9f, 0.9f, 0.9f}, math::normalize({0.9f, 0, 0.44f})});
  return scene.finish();
}

}  // namespace kiln::generate
