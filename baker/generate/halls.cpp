#include <array>
#include <memory>
#include <string>

#include "baker/generate/scenes.h"
#include "baker/generate/shapes.h"

// Two rooms in the manner of RTRad's: one under small lamps, one octagonal and all in textures.
namespace kiln::generate {
namespace {

using math::Vec3;
using Texel = std::array<std::uint8_t, 3>;

constexpr unsigned kUpright = kAllFaces & ~kFloor;

Texel shaded(int r, int g, int b, int shade) {
  const auto code = [&](int c) { return static_cast<std::uint8_t>(std::clamp(c + shade, 0, 255)); };
  return {code(r), code(g), code(b)};
}

/// Returns noise without a direction, 0 to `range` - 1.
int grain(std::uint32_t x, std::uint32_t y, std::uint32_t range) {
  std::uint32_t h = x * 374761393u + y * 668265263u;
  h = (h ^ (h >> 13)) * 1274126177u;
  return static_cast<int>((h ^ (h >> 16)) % range);
}

Texel bricks(std::uint32_t x, std::uint32_t y) {
  const std::uint32_t course = y / 16, shifted = (x + course % 2 * 16) % 128;
  if (y % 16 < 2 || shifted % 32 < 2) return shaded(176, 168, 156, grain(x, y, 12));
  return shaded(158, 92, 70, grain(shifted / 32, course, 40) - 20 + grain(x, y, 10));
}

Texel mosaic(std::uint32_t x, std::uint32_t y) {
  if (x % 16 < 1 || y % 16 < 1) return {92, 88, 82};
  const std::uint32_t u = x / 16, v = y / 16;
  const std::uint32_t ring = std::max(u < 4 ? 3 - u : u - 4, v < 4 ? 3 - v : v - 4);
  constexpr std::array<Texel, 4> kRings{
      {{196, 158, 74}, {214, 206, 190}, {58, 92, 122}, {206, 198, 182}}};
  const Texel& c = kRings[ring];
  return shaded(c[0], c[1], c[2], grain(u, v, 24) - 12 + grain(x, y, 6));
}

Texel planks(std::uint32_t x, std::uint32_t y) {
  if (x % 32 < 1) return {64, 44, 30};
  return shaded(140, 102, 66, grain(x / 32, 0, 36) - 18 + grain(x % 32, y / 24, 14));
}

Texel scales(std::uint32_t x, std::uint32_t y) {
  const std::uint32_t row = y / 16;
  const auto u = int((x + row % 2 * 16) % 32) - 16, v = int(y % 16);
  const int rim = u * u + v * v * 2;
  return rim > 330 ? Texel{30, 60, 46} : shaded(70, 138, 92, 40 - rim / 6);
}

/// A coiled serpent with a comb along its back and a raised head, in place of a scanned dragon.
class Serpent {
 public:
  static constexpr std::uint32_t kAround = 32, kAlong = 320;

  Serpent() {
    std::vector<Vec3> spine;
    for (std::uint32_t j = 0; j <= kAlong; ++j) spine.push_back(spine_at(float(j) / kAlong));
    Vec3 up{0, 1, 0};
    for (std::uint32_t j = 0; j <= kAlong; ++j) {
      const Vec3 tangent =
          math::normalize(spine[std::min(j + 1, kAlong)] - spine[j > 0 ? j - 1 : 0]);
      // The frame turns as little as it can from ring to ring.
      up = math::normalize(up - tangent * dot(up, tangent));
      add_ring(spine[j], up, cross(up, tangent), float(j) / kAlong);
    }
  }

  const Vec3& at(std::uint32_t i, std::uint32_t j) const {
    return points_[j * kAround + i % kAround];
  }
  Vec3 normal(std::uint32_t i, std::uint32_t j) const {
    const Vec3 u = at(i + 1, j) - at(i + kAround - 1, j);
    const Vec3 v = at(i, std::min(j + 1, kAlong)) - at(i, j > 0 ? j - 1 : 0);
    return math::normalize(cross(u, v));
  }

 private:
  static constexpr float kCoil = 0.7f;  // the share of the coil; neck and head follow

  static Vec3 spine_at(float s) {
    const float t = std::min(s / kCoil, 1.f);
    const float radius = 1.25f - 0.55f * t;
    const Vec3 coil =
        around_y(2.4 * double(t)) * radius + Vec3{0, 0.004f + thickness(s) + t * t, 0};
    if (s <= kCoil) return coil;
    // The neck goes on along the coil's end, rises, and bends forward to the head.
    const float n = (s - kCoil) / (1 - kCoil);
    const Vec3 out = around_y(2.4), forward{out.z, 0, -out.x};
    const float rise = n * n * (3 - 2 * n);
    return coil + forward * (1.8f * n * (1 - n) + 0.85f * n * n * n) - out * (0.4f * n * n) +
           Vec3{0, 0.55f * n + 0.85f * rise, 0};
  }

  /// Returns how much a ring belongs to the head, 0 to 1.
  static float head(float s) {
    const float t = std::max(0.f, 1 - std::abs(s - 0.935f) / 0.07f);
    return t * t * (3 - 2 * t);
  }

  static float thickness(float s) {
    const float body = 0.03f + 0.23f * std::min(1.f, 2.2f * s) * (1 - 0.6f * s);
    const float snout = std::max(0.f, (s - 0.92f) / 0.08f);
    return (body + 0.03f * head(s)) * (1 - 0.65f * snout * snout);
  }

  void add_ring(Vec3 middle, Vec3 up, Vec3 side, float s) {
    // Teeth of a comb, gone at the tail's tip and on the neck.
    const float saw = s * 46 - std::floor(s * 46);
    const float comb = 0.5f * (1 - std::abs(2 * saw - 1)) *
                       std::clamp(std::min(12 * s, 12 * (0.68f - s)), 0.f, 1.f);
    for (std::uint32_t i = 0; i < kAround; ++i) {
      const math::Vec2 d = on_circle(double(i) / kAround);
      const float back = std::max(0.f, (d.y - 0.85f) / 0.15f);
      const float belly = d.y < -0.5f ? 1 + (d.y + 0.5f) * 0.3f : 1.f;
      const float r = thickness(s) * (1 + comb * back * back) * belly;
      points_.push_back(middle + (side * (d.x * (1 + 0.4f * head(s))) + up * d.y) * r);
    }
  }

  std::vector<Vec3> points_;
};

void add_serpent(SceneBuilder& scene, const Part& part, Vec3 foot) {
  constexpr std::uint32_t kPieces = 8, kRows = Serpent::kAlong / kPieces;
  const Serpent serpent;
  for (std::uint32_t piece = 0; piece < kPieces; ++piece)
    add_sheet(
        scene, part, {Serpent::kAround, kRows, true},
        [&](std::uint32_t i, std::uint32_t j) { return foot + serpent.at(i, piece * kRows + j); },
        [&](std::uint32_t i, std::uint32_t j) { return serpent.normal(i, piece * kRows + j); });
  const auto close = [&](std::uint32_t row, bool backwards) {
    std::vector<Vec3> ring;
    Vec3 middle;
    for (std::uint32_t i = 0; i < Serpent::kAround; ++i) {
      ring.push_back(foot + serpent.at(backwards ? Serpent::kAround - i : i, row));
      middle += ring.back() * (1.f / Serpent::kAround);
    }
    add_fan(scene, part, ring, middle);
  };
  close(0, true);
  close(Serpent::kAlong, false);
}

struct Tiles {
  std::int32_t floor, ceiling;
};

/// Adds the floor and the ceiling of a regular octagon of side `a` in nine pieces each, none of
/// which stretches its texture: a square, four rectangles and four right triangles.
void add_octagon(SceneBuilder& scene, const Tiles& tiles, float a, float height) {
  const float b = a * 0.70710678f, h = a / 2;
  for (const float y : {0.f, height}) {
    const bool up = y == 0;
    const Part part{up ? "floor" : "ceiling", up ? tiles.floor : tiles.ceiling};
    const auto rectangle = [&](float x0, float x1, float z0, float z1) {
      if (up)
        add_corners(scene, part, {x0, y, z1}, {x1, y, z1}, {x1, y, z0}, {x0, y, z0});
      else
        add_corners(scene, part, {x0, y, z0}, {x1, y, z0}, {x1, y, z1}, {x0, y, z1});
    };
    rectangle(-h, h, -h, h);
    rectangle(-h, h, h, h + b);
    rectangle(-h, h, -h - b, -h);
    rectangle(h, h + b, -h, h);
    rectangle(-h - b, -h, -h, h);
    for (const float sx : {-1.f, 1.f})
      for (const float sz : {-1.f, 1.f}) {
        const Vec3 corner{sx * h, y, sz * h}, x{sx * (h + b), y, sz * h},
            z{sx * h, y, sz * (h + b)};
        if ((sx * sz < 0) == up)
          add_triangle(scene, part, corner, x, z);
        else
          add_triangle(scene, part, corner, z, x);
      }
  }
}

void add_chair(SceneBuilder& scene, const Part& part, Vec3 at, Vec3 axis_x) {
  const Vec3 axis_z = cross(axis_x, {0, 1, 0});
  const auto place = [&](float x, float y, float z) {
    return at + axis_x * x + axis_z * z + Vec3{0, y, 0};
  };
  for (const float x : {-0.19f, 0.19f})
    for (const float z : {-0.19f, 0.19f})
      add_box(scene, part, {place(x, 0, z), {0.05f, 0.42f, 0.05f}, axis_x}, kUpright & ~kCeiling);
  add_box(scene, part, {place(0, 0.42f, 0), {0.46f, 0.05f, 0.46f}, axis_x});
  add_box(scene, part, {place(0, 0.47f, -0.205f), {0.42f, 0.50f, 0.04f}, axis_x}, kUpright);
}

}  // namespace

std::string small_lights(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto plaster = scene.material("plaster", {0.72f, 0.70f, 0.66f});
  const auto floor = scene.material("floor", {0.45f, 0.33f, 0.22f});
  const auto blue = scene.material("blue", {0.2f, 0.3f, 0.5f});
  const auto wood = scene.material("wood", {0.5f, 0.34f, 0.18f});
  const auto warm = scene.material("warm lamp", {0, 0, 0}, {900, 720, 450});
  const auto cool = scene.material("cool lamp", {0, 0, 0}, {420, 560, 800});
  const Box box{{0, 0, 0}, {6, 2.8f, 5}};
  scene.room("room", floor, box, kFloor);
  scene.room("room", plaster, box, kCeiling | kLeft | kBack | kFront);
  scene.room("room", blue, box, kRight);

  add_box(scene, {"table", wood}, {{0, 0.71f, 0.2f}, {1.8f, 0.04f, 0.9f}});
  for (const float x : {-0.82f, 0.82f})
    for (const float z : {-0.18f, 0.58f})
      add_box(scene, {"table", wood}, {{x, 0, z}, {0.06f, 0.71f, 0.06f}}, kUpright & ~kCeiling);
  for (const float x : {-0.45f, 0.45f}) {
    add_chair(scene, {"chairs", wood}, {x, 0, 0.95f}, {-1, 0, 0});
    add_chair(scene, {"chairs", wood}, {x + 0.05f, 0, -0.55f}, math::normalize({0.98f, 0, 0.2f}));
  }
  add_box(scene, {"cupboard", wood}, {{-2.2f, 0, -2.2f}, {1.2f, 1.9f, 0.5f}}, kUpright);
  add_box(scene, {"screen", plaster},
          {{1.9f, 0, -1.2f}, {1.5f, 1.7f, 0.05f}, math::normalize({0.8f, 0, 0.6f})}, kUpright);
  for (int i = 0; i < 3; ++i)
    add_box(scene, {"shelf", wood}, {{2.85f, 0.9f + 0.4f * float(i), 1.2f}, {0.28f, 0.03f, 1.4f}});
  add_ellipsoid(scene, {"vase", blue}, {0.3f, 0.87f, 0.2f}, {0.11f, 0.12f, 0.11f}, {8, 8, 8});
  // Ten lamps of 8 cm, two centimeters under the ceiling.
  for (int i = 0; i < 10; ++i) {
    const float x = -2.4f + 1.2f * float(i % 5), z = i < 5 ? -1.3f : 1.5f;
    scene.quad("lamps", i % 3 == 1 ? cool : warm, {x - 0.04f, 2.78f, z - 0.04f}, {0.08f, 0, 0},
               {0, 0, 0.08f});
  }
  return scene.finish();
}

std::string octagon_textured(const std::string& name, std::uint32_t) {
  SceneBuilder scene(name);
  const auto textured = [&](const char* what, Texel (*texel)(std::uint32_t, std::uint32_t),
                            float size_m) {
    const auto m = scene.material(what, {0.95f, 0.95f, 0.95f});
    scene.texture(m, make_png(128, texel), size_m);
    return m;
  };
  const auto wall = textured("bricks", bricks, 1.6f);
  const auto skin = textured("scales", scales, 0.5f);
  const auto drum = textured("drum", mosaic, 1.2f);
  const Tiles tiles{textured("mosaic", mosaic, 2), textured("planks", planks, 1.6f)};

  constexpr float kSide = 3.6f, kHeight = 4.2f;
  const float h = kSide / 2, b = kSide * 0.70710678f;
  add_octagon(scene, tiles, kSide, kHeight);
  // Walls from the eastern one on, counterclockwise seen from above.
  const std::array<Vec3, 8> corners{{{h + b, 0, h},
                                     {h + b, 0, -h},
                                     {h, 0, -h - b},
                                     {-h, 0, -h - b},
                                     {-h - b, 0, -h},
                                     {-h - b, 0, h},
                                     {-h, 0, h + b},
                                     {h, 0, h + b}}};
  constexpr std::array<math::Rgb, 4> kColors{
      {{60, 22, 14}, {16, 46, 18}, {14, 26, 66}, {56, 46, 16}}};
  for (std::size_t i = 0; i < 8; ++i) {
    const Vec3 from = corners[(i + 1) % 8], to = corners[i], up{0, kHeight, 0};
    add_corners(scene, {"walls", wall}, from, to, to + up, from + up);
    if (i % 2 == 0) continue;
    // A glowing panel hangs before every second wall, 3 cm off it.
    const Vec3 along = math::normalize(to - from), in = cross(along, {0, 1, 0});
    const auto lamp =
        scene.material("lamp " + std::to_string(i / 2 + 1), {0, 0, 0}, kColors[i / 2]);
    scene.quad("lamp " + std::to_string(i / 2 + 1), lamp,
               (from + to) * 0.5f - along * 0.5f + in * 0.03f + Vec3{0, 1.6f, 0}, along,
               {0, 1.2f, 0});
  }
  add_lathe(scene, {"drum", drum}, {0, 0, 0}, {{1.75f, 0}, {1.75f, 0.3f}, {1.72f, 0.33f}}, 48,
            Ends::kTop);
  add_serpent(scene, {"serpent", skin}, {0, 0.33f, 0});
  return scene.finish();
}

}  // namespace kiln::generate
