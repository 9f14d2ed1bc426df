#include <string>

#include "baker/generate/scenes.h"
#include "baker/generate/shapes.h"

// An open car for bad roads, 3.4 m long. It stands on y = 0 and looks along +X; lengths are in
// meters.
namespace kiln::generate {
namespace {

using math::Vec3;

constexpr float kWheel = 0.37f, kAxleFront = 1.02f, kAxleRear = -1.02f, kTrack = 0.70f;

struct Paints {
  std::int32_t body, dark, tire, metal, canvas, glass;
};

/// Adds a wheel whose axle points along `axis` (+Z or -Z), outwards.
void add_wheel(SceneBuilder& scene, const Paints& m, Vec3 center, const Frame& frame) {
  const float w = 0.11f;  // half the tire's width
  add_turned_lathe(scene, {"tires", m.tire}, center, frame,
                   {{0.22f, -w + 0.01f},
                    {0.30f, -w},
                    {0.35f, -w + 0.02f},
                    {kWheel, -w + 0.06f},
                    {kWheel, w - 0.06f},
                    {0.35f, w - 0.02f},
                    {0.30f, w},
                    {0.22f, w - 0.01f}},
                   20, Ends::kOpen);
  // The rim is a bowl with a hub; both sides of the wheel are closed by it.
  add_turned_lathe(scene, {"rims", m.metal}, center, frame,
                   {{0.22f, w - 0.01f}, {0.20f, w - 0.05f}, {0.10f, w - 0.05f}, {0.08f, w - 0.01f}},
                   20, Ends::kTop);
  std::vector<Vec3> ring;
  for (int i = 0; i < 20; ++i) {
    const Vec3 d = around_y(double((20 - i) % 20) / 20);
    ring.push_back(center + frame.x * (d.x * 0.22f) + frame.z * (d.z * 0.22f) +
                   frame.y * (0.01f - w));
  }
  add_fan(scene, {"rims", m.metal}, ring, center + frame.y * (0.01f - w));
}

/// Adds a fender: a band of sheet metal over a wheel, thick enough to have two sides.
void add_fender(SceneBuilder& scene, const Part& part, float axle, float z, float out) {
  constexpr std::uint32_t kSteps = 12;
  const float inner = 0.43f, outer = 0.47f, half = 0.15f;
  const auto at = [&](std::uint32_t corner, std::uint32_t step) {
    const math::Vec2 arc = on_circle(0.02 + 0.46 * double(step) / kSteps);
    const float radius = corner == 1 || corner == 2 ? outer : inner;
    const float side = corner < 2 ? out : -out;
    return Vec3{axle + radius * arc.x, kWheel + radius * arc.y, z + half * side};
  };
  const auto strip = [&](std::uint32_t from, std::uint32_t to) {
    add_sheet(scene, part, {1, kSteps}, [&](std::uint32_t i, std::uint32_t step) {
      return at((i == 0) == (out > 0) ? from : to, step);
    });
  };
  for (std::uint32_t c = 0; c < 4; ++c) strip(c, (c + 1) % 4);
  const auto end = [&](std::uint32_t step, bool turned) {
    if (turned)
      add_corners(scene, part, at(3, step), at(2, step), at(1, step), at(0, step));
    else
      add_corners(scene, part, at(0, step), at(1, step), at(2, step), at(3, step));
  };
  end(0, out > 0), end(kSteps, out < 0);
}

void add_body(SceneBuilder& scene, const Paints& m) {
  const Part body{"body", m.body};
  // Tub: floor, sides with a low door, back. Each is a closed slab.
  add_box(scene, body, {{-0.45f, 0.48f, 0}, {2.3f, 0.08f, 1.1f}});
  for (const float side : {-1.f, 1.f}) {
    add_box(scene, body, {{-1.2f, 0.56f, side * 0.53f}, {0.8f, 0.42f, 0.04f}});
    add_box(scene, body, {{-0.45f, 0.56f, side * 0.53f}, {0.7f, 0.16f, 0.04f}});
    add_box(scene, body, {{0.25f, 0.56f, side * 0.53f}, {0.7f, 0.42f, 0.04f}});
  }
  add_box(scene, body, {{-1.58f, 0.56f, 0}, {0.04f, 0.42f, 1.02f}});
  add_box(scene, body, {{0.58f, 0.56f, 0}, {0.04f, 0.42f, 1.02f}});
  // The hood is a little round from side to side.
  constexpr std::uint32_t kAcross = 10, kAlong = 6;
  const auto hood = [&](std::uint32_t i, std::uint32_t j) {
    const float t = 2 * float(j) / kAlong - 1;
    const float x = 0.6f + 0.85f * float(i) / kAcross;
    return Vec3{x, 0.98f - 0.05f * (x - 0.6f) - 0.05f * t * t, -0.45f * t};
  };
  add_sheet(scene, body, {kAcross, kAlong},
            [&](std::uint32_t i, std::uint32_t j) { return hood(i, j); });
  for (const bool left : {true, false}) {
    const std::uint32_t j = left ? kAlong : 0;
    add_sheet(scene, body, {kAcross, 1}, [&](std::uint32_t column, std::uint32_t row) {
      Vec3 p = hood(left ? kAcross - column : column, j);
      if (row == 0) p.y = 0.52f;
      return p;
    });
  }
  add_sheet(scene, {"grille", m.dark}, {kAlong, 1}, [&](std::uint32_t column, std::uint32_t row) {
    Vec3 p = hood(kAcross, column);
    if (row == 0) p.y = 0.52f;
    return p;
  });
  for (int i = 0; i < 7; ++i)
    add_box(scene, {"grille", m.metal},
            {{1.465f, 0.56f, -0.24f + 0.08f * float(i)}, {0.03f, 0.30f, 0.03f}});
}

void add_fittings(SceneBuilder& scene, const Paints& m) {
  const Frame forwards{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}};
  for (const float side : {-1.f, 1.f}) {
    add_turned_lathe(scene, {"headlights", m.glass}, {1.45f, 0.76f, side * 0.36f}, forwards,
                     {{0.07f, 0}, {0.09f, 0.02f}, {0.09f, 0.06f}, {0.06f, 0.085f}}, 12, Ends::kTop);
    add_box(scene, {"frame", m.dark}, {{0, 0.36f, side * 0.38f}, {3.2f, 0.12f, 0.08f}});
    add_box(scene, {"windscreen", m.body}, {{0.52f, 0.98f, side * 0.52f}, {0.04f, 0.46f, 0.04f}},
            kAllFaces & ~kFloor);
    // Seats.
    add_box(scene, {"seats", m.canvas}, {{-0.35f, 0.56f, side * 0.26f}, {0.42f, 0.22f, 0.42f}},
            kAllFaces & ~kFloor);
    add_box(scene, {"seats", m.canvas}, {{-0.60f, 0.60f, side * 0.26f}, {0.10f, 0.56f, 0.42f}});
    // The roll bar's posts.
    add_lathe(scene, {"roll bar", m.metal}, {-0.82f, 0.56f, side * 0.46f},
              {{0.03f, 0}, {0.03f, 0.45f}, {0.03f, 0.90f}}, 8, Ends::kTop);
  }
  add_box(scene, {"seats", m.dark}, {{0.05f, 0.56f, 0}, {0.03f, 0.28f, 0.03f}},
          kAllFaces & ~kFloor);  // the gear stick
  for (const float y : {0.98f, 1.44f})
    add_box(scene, {"windscreen", m.body}, {{0.52f, y, 0}, {0.04f, 0.04f, y < 1 ? 1.0f : 1.08f}});
  const Frame across{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}};
  add_turned_lathe(scene, {"roll bar", m.metal}, {-0.82f, 1.43f, -0.46f}, across,
                   {{0.03f, 0}, {0.03f, 0.46f}, {0.03f, 0.92f}}, 8, Ends::kBoth);
  for (const float x : {-1.69f, 1.62f})
    add_box(scene, {"bumpers", m.metal}, {{x, 0.42f, 0}, {0.08f, 0.12f, 1.3f}});
  const Frame wheel{{0.8f, 0.6f, 0}, {-0.6f, 0.8f, 0}, {0, 0, 1}};
  add_torus(scene, {"steering wheel", m.dark}, {0.12f, 1.0f, 0.26f}, wheel, 0.17f, 0.016f, 20, 6);
  add_turned_lathe(scene, {"steering wheel", m.dark}, {0.42f, 0.6f, 0.26f}, wheel,
                   {{0.018f, 0}, {0.018f, 0.5f}}, 8, Ends::kTop);
  add_box(scene, {"steering wheel", m.dark}, {{0.12f, 0.985f, 0.26f}, {0.03f, 0.03f, 0.32f}});
}

}  // namespace

std::string jeep(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const Paints m{
      scene.material("paint", {0.25f, 0.32f, 0.14f}), scene.material("dark", {0.08f, 0.08f, 0.08f}),
      scene.material("tire", {0.05f, 0.05f, 0.05f}),  scene.material("metal", {0.5f, 0.5f, 0.48f}),
      scene.material("canvas", {0.5f, 0.42f, 0.28f}), scene.material("glass", {0.8f, 0.8f, 0.75f})};
  const auto sand = scene.material("sand", {0.6f, 0.5f, 0.34f});
  const auto lamp = scene.material("lamp", {0, 0, 0}, {40, 36, 30});
  scene.quad("ground", sand, {-3, 0, 3}, {6, 0, 0}, {0, 0, -6});
  scene.quad("lamp", lamp, {0.5f, 4, 0.5f}, {1, 0, 0}, {0, 0, 1});

  add_body(scene, m);
  add_fittings(scene, m);
  for (const float side : {-1.f, 1.f})
    for (const float x : {kAxleFront, kAxleRear}) {
      // The wheel's own Y is the axle, outwards.
      const Frame frame{{1, 0, 0}, {0, 0, side}, {0, -side, 0}};
      add_wheel(scene, m, {x, kWheel, side * kTrack}, frame);
      add_fender(scene, {"fenders", m.body}, x, side * kTrack, side);
    }
  const Frame backwards{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
  add_wheel(scene, m, {-1.72f, 0.86f, 0}, backwards);
  return scene.finish();
}

}  // namespace kiln::generate
