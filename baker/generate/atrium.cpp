#include <array>
#include <string>

#include "baker/generate/scenes.h"
#include "baker/generate/shapes.h"

// A court of two storeys with arcades, open to the sky: our own, in the place of the palace of
// Sponza. Lengths are in meters; the court's middle is the origin and its floor is y = 0.
namespace kiln::generate {
namespace {

using math::Vec3;

constexpr int kBaysX = 6, kBaysZ = 3;
constexpr float kBay = 2.4f, kGallery = 2.8f, kWall = 0.5f;
constexpr float kCourtX = kBaysX * kBay, kCourtZ = kBaysZ * kBay;  // between the axes of columns
constexpr float kSlab = 0.4f;                                      // of a floor between storeys
constexpr float kSpring = 2.9f, kStorey = 4.6f;  // heights of the arches' feet and of a storey
constexpr float kUpper = kStorey + kSlab;        // height of the upper floor

struct Materials {
  std::int32_t stone, plaster, floor, rail;
};

/// A place on the arcade: `at` lies on the axis of the columns, `along` runs with the court on the
/// left, `out` points into the gallery.
struct Side {
  Vec3 start, along, out;
  int bays = 0;
  std::string name;
};

std::array<Side, 4> sides() {
  const float x = kCourtX / 2, z = kCourtZ / 2;
  return {{{{-x, 0, z}, {1, 0, 0}, {0, 0, 1}, kBaysX, "south"},
           {{x, 0, z}, {0, 0, -1}, {1, 0, 0}, kBaysZ, "east"},
           {{x, 0, -z}, {-1, 0, 0}, {0, 0, -1}, kBaysX, "north"},
           {{-x, 0, -z}, {0, 0, 1}, {-1, 0, 0}, kBaysZ, "west"}}};
}

/// A height of a column: the half width of its section there, how square that is (0: a circle,
/// 1: a square) and how deep its flutes are.
struct Section {
  float height = 0, half = 1, square = 0, flute = 0;
};

std::vector<Section> sections_of_column() {
  std::vector<Section> s{{0, 0.25f, 1},      {0.10f, 0.25f, 1},  {0.12f, 0.24f, 0.6f},
                         {0.14f, 0.225f, 0}, {0.15f, 0.225f, 0}, {0.17f, 0.24f, 0},
                         {0.21f, 0.24f, 0},  {0.24f, 0.22f, 0},  {0.26f, 0.20f, 0},
                         {0.29f, 0.205f, 0}, {0.32f, 0.19f, 0},  {0.36f, 0.18f, 0}};
  constexpr int kRows = 8;
  for (int i = 0; i <= kRows; ++i) {  // the shaft swells a little and tapers
    const float t = float(i) / kRows;
    const bool end = i == 0 || i == kRows;
    s.push_back({0.40f + 1.86f * t, 0.178f + 0.010f * t - 0.032f * t * t, 0, end ? 0 : 0.016f});
  }
  const std::array<Section, 10> capital{{{2.30f, 0.165f, 0},
                                         {2.33f, 0.178f, 0},
                                         {2.36f, 0.165f, 0},
                                         {2.44f, 0.168f, 0.05f},
                                         {2.54f, 0.19f, 0.2f},
                                         {2.63f, 0.225f, 0.55f},
                                         {2.70f, 0.25f, 0.9f},
                                         {2.74f, 0.255f, 1},
                                         {2.87f, 0.255f, 1},
                                         {2.90f, 0.245f, 1}}};
  s.insert(s.end(), capital.begin(), capital.end());
  return s;
}

/// Adds a column with base, fluted shaft and capital as one chart.
void add_column(SceneBuilder& scene, const Part& part, Vec3 foot) {
  constexpr std::uint32_t kFlutes = 20, kAcross = 4, kSegments = kFlutes * kAcross;
  static const std::vector<Section> sections = sections_of_column();
  const auto rows = static_cast<std::uint32_t>(sections.size()) - 1;
  add_sheet(scene, part, {kSegments, rows, true}, [&](std::uint32_t i, std::uint32_t j) {
    const Section& s = sections[j];
    // The first segment lies on a corner of the square.
    const Vec3 d = around_y(double(i) / kSegments + 0.125);
    const float to_square = 1 / std::max(std::abs(d.x), std::abs(d.z));
    const float in_flute = i % kAcross == 0 ? 0.f : i % kAcross == 2 ? 1.f : 0.75f;
    const float radius = s.half * (1 + s.square * (to_square - 1)) - s.flute * in_flute;
    return foot + d * radius + Vec3{0, s.height, 0};
  });
}

/// Adds an arch over a bay: its face to the court, its face to the gallery, and its underside.
void add_arch(SceneBuilder& scene, const Part& part, Vec3 foot, const Side& side, float top) {
  constexpr std::uint32_t kSteps = 28;
  constexpr float kHalfSpan = kBay / 2 - 0.25f;
  // The lower edge: level over the capitals, round between them.
  const auto edge = [&](std::uint32_t i, float across) {
    Vec3 p = foot + side.out * across + Vec3{0, kSpring, 0};
    if (i == 0) return p;
    if (i == kSteps + 2) return p + side.along * kBay;
    const math::Vec2 arc = on_circle(0.5 - 0.5 * double(i - 1) / kSteps);
    p += side.along * (kBay / 2 + kHalfSpan * arc.x);
    p.y += kHalfSpan * arc.y;
    return p;
  };
  const auto face = [&](float across, bool to_court) {
    add_sheet(scene, part, {kSteps + 2, 3}, [&](std::uint32_t column, std::uint32_t j) {
      const std::uint32_t i = to_court ? kSteps + 2 - column : column;
      const Vec3 low = edge(i, across);
      const float share = float(i) / float(kSteps + 2);
      Vec3 high = foot + side.out * across + side.along * (share * kBay);
      high.y = top;
      return low + (high - low) * (float(j) / 3);
    });
  };
  face(-kWall / 2, true);
  face(kWall / 2, false);
  add_sheet(scene, part, {kSteps, 2}, [&](std::uint32_t i, std::uint32_t j) {
    return edge(i + 1, kWall * (float(j) / 2 - 0.5f));
  });
}

void add_baluster(SceneBuilder& scene, const Part& part, Vec3 foot) {
  static const std::vector<LatheRing> rings{
      {0.062f, 0},     {0.062f, 0.05f}, {0.045f, 0.07f}, {0.036f, 0.11f}, {0.052f, 0.17f},
      {0.064f, 0.24f}, {0.066f, 0.30f}, {0.054f, 0.39f}, {0.038f, 0.48f}, {0.032f, 0.56f},
      {0.046f, 0.59f}, {0.046f, 0.62f}, {0.034f, 0.65f}, {0.055f, 0.69f}, {0.055f, 0.72f}};
  add_lathe(scene, part, foot, rings, 16, Ends::kOpen);
}

/// Adds a bay's balustrade between two columns of the upper storey.
void add_balustrade(SceneBuilder& scene, const Part& part, Vec3 foot, const Side& side) {
  constexpr float kFree = kBay - 0.50f;
  constexpr int kBalusters = 5;
  const Vec3 middle = foot + side.along * (kBay / 2);
  add_box(scene, part, {middle, {kFree, 0.12f, 0.24f}, side.along}, kAllFaces & ~kFloor);
  add_box(scene, part, {middle + Vec3{0, 0.84f, 0}, {kFree, 0.10f, 0.26f}, side.along});
  for (int i = 0; i < kBalusters; ++i)
    add_baluster(scene, part,
                 middle + side.along * (kFree * ((float(i) + 0.5f) / kBalusters - 0.5f)) +
                     Vec3{0, 0.12f, 0});
}

/// Closes the walls over a corner's column towards the gallery. Each ends at the column's axis.
void add_corner(SceneBuilder& scene, const Part& part, Vec3 axis, Vec3 out, Vec3 other_out,
                float top) {
  const auto upright = [&](Vec3 a, Vec3 b) {
    Vec3 a_top = a, b_top = b;
    a_top.y = b_top.y = top;
    add_corners(scene, part, a, b, b_top, a_top);
  };
  const Vec3 p = out * (kWall / 2), q = other_out * (kWall / 2);
  axis.y += kSpring;
  upright(axis + p + q, axis + p);
  upright(axis + q, axis + p + q);
}

void add_storey(SceneBuilder& scene, const Materials& m, float floor, bool upper) {
  const std::string storey = upper ? "upper" : "lower";
  const std::array<Side, 4> all = sides();
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Vec3 corner = all[k].start + Vec3{0, floor, 0};
    add_corner(scene, {storey + " arches", m.stone}, corner, all[k].out, all[(k + 3) % 4].out,
               floor + kStorey);
  }
  for (const Side& side : all)
    for (int bay = 0; bay < side.bays; ++bay) {
      Vec3 foot = side.start + side.along * (kBay * float(bay));
      foot.y = floor;
      add_column(scene, {storey + " columns", m.stone}, foot);
      add_arch(scene, {storey + " arches", m.stone}, foot, side, floor + kStorey);
      if (upper) add_balustrade(scene, {"balustrade", m.rail}, foot, side);
    }
}

/// Adds four rectangles around the court, from its edge to `outer` meters beyond the axes.
void add_ring(SceneBuilder& scene, const Part& part, float y, bool facing_up) {
  const float x0 = kCourtX / 2 - kWall / 2, z0 = kCourtZ / 2 - kWall / 2;
  const float x1 = kCourtX / 2 + kGallery, z1 = kCourtZ / 2 + kGallery;
  const auto level = [&](float xa, float xb, float za, float zb) {
    if (facing_up)
      add_corners(scene, part, {xa, y, zb}, {xb, y, zb}, {xb, y, za}, {xa, y, za});
    else
      add_corners(scene, part, {xa, y, za}, {xb, y, za}, {xb, y, zb}, {xa, y, zb});
  };
  level(-x1, x1, z0, z1);
  level(-x1, x1, -z1, -z0);
  level(x0, x1, -z0, z0);
  level(-x1, -x0, -z0, z0);
}

/// Adds the band of a slab around the court, and the roof's edge, seen from the court.
void add_band(SceneBuilder& scene, const Part& part, float low, float high) {
  const float x = kCourtX / 2 - kWall / 2, z = kCourtZ / 2 - kWall / 2;
  const auto upright = [&](Vec3 a, Vec3 b) {
    a.y = b.y = low;
    const Vec3 up{0, high - low, 0};
    add_corners(scene, part, a, b, b + up, a + up);
  };
  upright({x, 0, z}, {-x, 0, z});
  upright({x, 0, -z}, {x, 0, z});
  upright({-x, 0, -z}, {x, 0, -z});
  upright({-x, 0, z}, {-x, 0, -z});
}

}  // namespace

std::string atrium(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const Materials m{scene.material("stone", {0.62f, 0.56f, 0.46f}),
                    scene.material("plaster", {0.72f, 0.55f, 0.42f}),
                    scene.material("floor", {0.5f, 0.46f, 0.42f}),
                    scene.material("rail", {0.7f, 0.68f, 0.64f})};
  constexpr float kTop = kUpper + kStorey, kRoof = kTop + kSlab;
  const float x1 = kCourtX / 2 + kGallery, z1 = kCourtZ / 2 + kGallery;

  add_corners(scene, {"floor", m.floor}, {-x1, 0, z1}, {x1, 0, z1}, {x1, 0, -z1}, {-x1, 0, -z1});
  add_storey(scene, m, 0, false);
  add_ring(scene, {"lower ceiling", m.plaster}, kStorey, false);
  add_band(scene, {"lower band", m.stone}, kStorey, kUpper);
  add_ring(scene, {"upper floor", m.floor}, kUpper, true);
  add_storey(scene, m, kUpper, true);
  add_ring(scene, {"upper ceiling", m.plaster}, kTop, false);
  add_band(scene, {"upper band", m.stone}, kTop, kRoof);
  add_ring(scene, {"roof", m.plaster}, kRoof, true);

  for (const float low : {0.f, kUpper})
    scene.room("outer wall", m.plaster, {{0, low, 0}, {2 * x1, kStorey, 2 * z1}},
               kLeft | kRight | kBack | kFront);
  gltf::GlbLight sun;
  sun.name = "sun";
  sun.type = gltf::GlbLight::Type::kDirectional;
  sun.color = {1, 0.94f, 0.84f};
  sun.intensity = 30000;
  scene.light(sun, {0, kRoof + 5, 0}, {0.45f, -1, -0.38f});
  return scene.finish();
}

}  // namespace kiln::generate
