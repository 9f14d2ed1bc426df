#include "baker/simd/kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"

namespace kiln::simd {
namespace {

std::vector<InstructionSet> available() {
  std::vector<InstructionSet> sets{InstructionSet::kSse2};
  if (best_instruction_set() >= InstructionSet::kAvx2) sets.push_back(InstructionSet::kAvx2);
  if (best_instruction_set() >= InstructionSet::kAvx512) sets.push_back(InstructionSet::kAvx512);
  return sets;
}

PointFrames frames_about(math::Vec3 normal, math::Vec3 geometric) {
  PointFrames f{};
  const sampling::Frame frame(normal);
  for (int i = 0; i < 16; ++i)
    for (int k = 0; k < 3; ++k) {
      f.tangent_x[k][i] = frame.x[k];
      f.tangent_y[k][i] = frame.y[k];
      f.shading_normal[k][i] = normal[k];
      f.geometric_normal[k][i] = geometric[k];
    }
  return f;
}

struct SobolPacket {
  std::uint32_t x[16], y[16];
  explicit SobolPacket(std::uint32_t first) {
    for (std::uint32_t i = 0; i < 16; ++i)
      x[i] = sampling::sobol(first + i).x, y[i] = sampling::sobol(first + i).y;
  }
};

/// Each lane with seeds of its own.
ScrambledPoints scrambled_points(std::uint32_t first, std::uint32_t seed, std::uint32_t shared) {
  ScrambledPoints p;
  const SobolPacket packet(first);
  std::copy_n(packet.x, 16, p.x);
  std::copy_n(packet.y, 16, p.y);
  for (std::uint32_t i = 0; i < 16; ++i) {
    p.seed_x[i] = sampling::hash(seed, i);
    p.seed_y[i] = sampling::hash(p.seed_x[i]);
  }
  p.shared_x = p.shared_y = shared;
  p.shared_seed_x = sampling::hash(seed), p.shared_seed_y = sampling::hash(seed, 99);
  return p;
}

// The kernel's polynomials against the library's functions, lane by lane.
TEST(Kernels, DirectionsAreTheConcentricMap) {
  const math::Vec3 normal = normalize(math::Vec3{0.3f, -0.5f, 0.8f}), up{0, 0, 1};
  const PointFrames frames = frames_about(normal, up);
  for (std::uint32_t first = 0; first < 4096; first += 16) {
    const ScrambledPoints points = scrambled_points(first, sampling::hash(first), 0);
    Directions d;
    kernels().directions(points, frames, d);
    for (std::uint32_t i = 0; i < 16; ++i) {
      const math::Vec3 expected = sampling::Frame(normal).to_world(sampling::cosine_direction(
          sampling::scrambled({points.x[i], points.y[i]}, points.seed_x[i])));
      for (int k = 0; k < 3; ++k) ASSERT_NEAR(d.direction[k][i], expected[k], 2e-6f);
      ASSERT_NEAR(d.above[i], dot(expected, up), 2e-6f);
    }
  }
}

// With their upper bits scrambled alike, all lanes send a point into the same cell of the square,
// and each lane's points are still one to an elementary interval, however that is cut.
TEST(Kernels, SharedBitsKeepEveryLaneANet) {
  constexpr std::uint32_t kBits = 3, kCount = 1u << 2 * kBits;
  const PointFrames frames = frames_about({0, 0, 1}, {0, 0, 1});
  std::vector<math::Vec2> of_lane[16];
  for (std::uint32_t s = 0; s < kCount; ++s) {
    ScrambledPoints points = scrambled_points(0, 77, ~0u << (32 - kBits));
    std::fill_n(points.x, 16, sampling::sobol(s).x);
    std::fill_n(points.y, 16, sampling::sobol(s).y);
    Directions d;
    kernels().directions(points, frames, d);
    for (std::uint32_t i = 0; i < 16; ++i) {
      // Back to the square by the inverse of the concentric map.
      float x = 0, y = 0;
      for (int k = 0; k < 3; ++k) {
        x += d.direction[k][i] * frames.tangent_x[k][i];
        y += d.direction[k][i] * frames.tangent_y[k][i];
      }
      const float r = std::hypot(x, y);
      const bool wide = std::abs(x) > std::abs(y);
      const float a = wide ? std::copysign(r, x) : r * std::atan2(x, std::abs(y)) * 4 / math::kPi;
      const float b = wide ? r * std::atan2(y, std::abs(x)) * 4 / math::kPi : std::copysign(r, y);
      of_lane[i].push_back({(a + 1) / 2, (b + 1) / 2});
    }
    for (std::uint32_t i = 1; i < 16; ++i) {
      EXPECT_EQ(int(of_lane[i][s].x * 8), int(of_lane[0][s].x * 8)) << s;
      EXPECT_EQ(int(of_lane[i][s].y * 8), int(of_lane[0][s].y * 8)) << s;
    }
    EXPECT_NE(of_lane[1][s].x, of_lane[0][s].x);
  }
  for (const auto& lane : of_lane)
    for (std::uint32_t across = 0; across <= 2 * kBits; ++across) {
      std::vector<int> met(kCount);
      const float columns = float(1u << across), rows = float(kCount >> across);
      for (const math::Vec2 p : lane)
        ++met[std::size_t(p.x * columns) * std::size_t(rows) + std::size_t(p.y * rows)];
      EXPECT_EQ(std::count(met.begin(), met.end(), 1), kCount) << across;
    }
}

TEST(Kernels, EveryInstructionSetGivesTheSameBits) {
  const PointFrames frames = frames_about(normalize(math::Vec3{-0.6f, 0.1f, 0.4f}),
                                          normalize(math::Vec3{-0.5f, 0.2f, 0.4f}));
  for (const std::uint32_t shared : {0u, 0xe0000000u}) {
    const ScrambledPoints points = scrambled_points(112, 123, shared);
    Directions reference;
    kernels(InstructionSet::kSse2).directions(points, frames, reference);
    for (const InstructionSet set : available()) {
      Directions d;
      kernels(set).directions(points, frames, d);
      EXPECT_EQ(std::memcmp(&d, &reference, sizeof d), 0) << kernels(set).name;
    }
  }
}

/// Points scattered under a lamp, some of which it crosses the horizon of.
PointFrames points_under_lamp() {
  PointFrames f = frames_about(normalize(math::Vec3{0.1f, 0.9f, -0.2f}), {0, 1, 0});
  for (std::uint32_t i = 0; i < 16; ++i) {
    const math::Vec2 u = scrambled(sampling::sobol(i), 7);
    const math::Vec3 p{3 * u.x - 1.5f, i % 4 == 0 ? 0.9f : 0.f, 3 * u.y - 1.5f};
    for (int k = 0; k < 3; ++k) f.position[k][i] = f.origin[k][i] = p[k];
  }
  return f;
}
LightShape lamp(std::int32_t corners) {
  LightShape l{{{-0.5f, 1, -0.5f}, {0.5f, 1, -0.5f}, {0.5f, 1, 0.5f}, {-0.5f, 1, 0.5f}},
               {0, -1, 0},
               corners == 4 ? 1.f : 0.5f,
               corners};
  if (corners == 3) std::copy(l.corner[2], l.corner[2] + 3, l.corner[3]);
  return l;
}

TEST(Kernels, ViewOfALightIsLambertsFormula) {
  const PointFrames f = points_under_lamp();
  for (const std::int32_t corners : {3, 4}) {
    const LightShape l = lamp(corners);
    std::array<math::Vec3, 4> outline;
    for (int c = 0; c < 4; ++c) outline[c] = {l.corner[c][0], l.corner[c][1], l.corner[c][2]};
    LightView view;
    kernels().view_light(l, f, view);
    int checked = 0;
    for (int i = 0; i < 16; ++i) {
      const math::Vec3 p{f.position[0][i], f.position[1][i], f.position[2][i]};
      EXPECT_NEAR(view.height[i], 1 - p.y, 1e-6);
      if (view.lowest[i] < 0) continue;
      ++checked;
      const math::Vec3 n{f.shading_normal[0][i], f.shading_normal[1][i], f.shading_normal[2][i]};
      EXPECT_NEAR(view.irradiance[i],
                  sampling::polygon_irradiance(p, n, {outline.data(), std::size_t(corners)}), 3e-6);
    }
    EXPECT_GE(checked, 8);
  }
}

// A point right beside the edge of a lamp sees the edge as a straight line: the sine of its angle
// is next to nothing. Receivers in the plane of the edge, nearer and nearer below it, against the
// formula in double precision.
TEST(Kernels, ViewOfALightFromBesideItsEdge) {
  LightShape l{};
  const float corner[4][3] = {{0, 0, -1}, {1, 0, -1}, {1, 0, 1}, {0, 0, 1}};
  std::copy_n(&corner[0][0], 12, &l.corner[0][0]);
  l.normal[1] = -1, l.area_m2 = 2, l.corners = 4;
  PointFrames f{};
  for (int i = 0; i < 16; ++i) {
    f.position[1][i] = -std::pow(0.3f, float(i));  // down to 1.4e-8
    f.shading_normal[0][i] = f.geometric_normal[0][i] = 1;
  }
  LightView view;
  kernels().view_light(l, f, view);
  for (int i = 0; i < 16; ++i) {
    const double h = -double(f.position[1][i]);
    double sum = 0;
    for (int k = 0; k < 4; ++k) {
      const auto at = [&](int c) {
        const double x = double(corner[c % 4][0]), z = double(corner[c % 4][2]);
        const double s = 1 / std::sqrt(x * x + h * h + z * z);
        return std::array<double, 3>{x * s, h * s, z * s};
      };
      const auto a = at(k), b = at(k + 1);
      const double cx = a[1] * b[2] - a[2] * b[1], cy = a[2] * b[0] - a[0] * b[2],
                   cz = a[0] * b[1] - a[1] * b[0];
      const double sine = std::sqrt(cx * cx + cy * cy + cz * cz);
      sum += cx * std::atan2(sine, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / sine;
    }
    EXPECT_NEAR(view.irradiance[i], std::abs(sum) / 2, 1e-5) << h;
  }
}

// The mean of the samples' weights is the irradiance; QMC error of 4096 points.
TEST(Kernels, SamplesOfALightAverageToLambertsFormula) {
  const PointFrames f = points_under_lamp();
  for (const std::int32_t corners : {3, 4}) {
    const LightShape l = lamp(corners);
    LightView view;
    kernels().view_light(l, f, view);
    std::array<double, 16> sum{};
    for (std::uint32_t first = 0; first < 4096; first += 16) {
      const SobolPacket packet(first);
      // Over all flips each point meets every sample once.
      for (std::uint32_t flip = 0; flip < 16; ++flip) {
        LightRays rays;
        kernels().sample_light(l, packet.x, packet.y, flip, 5, 6, f, 1e-5f, rays);
        for (int i = 0; i < 16; ++i) sum[i] += rays.weight[i] / 4096;
      }
    }
    for (int i = 0; i < 16; ++i) {
      if (view.lowest[i] <= 0.1f) continue;
      EXPECT_NEAR(sum[i], view.irradiance[i], 2e-3 * view.irradiance[i]);
    }
  }
}

TEST(Kernels, LightsHaveTheSameBitsInEveryInstructionSet) {
  const PointFrames f = points_under_lamp();
  const SobolPacket packet(48);
  for (const std::int32_t corners : {3, 4}) {
    LightView view;
    LightRays rays;
    const Kernels& plain = kernels(InstructionSet::kSse2);
    plain.view_light(lamp(corners), f, view);
    plain.sample_light(lamp(corners), packet.x, packet.y, 3, 5, 6, f, 1e-5f, rays);
    for (const InstructionSet set : available()) {
      LightView v;
      LightRays r;
      kernels(set).view_light(lamp(corners), f, v);
      kernels(set).sample_light(lamp(corners), packet.x, packet.y, 3, 5, 6, f, 1e-5f, r);
      EXPECT_EQ(std::memcmp(&v, &view, sizeof v), 0) << kernels(set).name;
      EXPECT_EQ(std::memcmp(&r, &rays, sizeof r), 0) << kernels(set).name;
    }
  }
}

/// A page of 8 x 8 texels, all of one chart but the last row and column, and one triangle over it.
struct SmallPage {
  std::vector<std::int32_t> cells = std::vector<std::int32_t>(64);
  PlacedTriangle triangle{{0, 0}, {8, 0}, {0, 8}, 0, 0};
  SmallPage() {
    for (int c = 0; c < 64; ++c) cells[c] = c | (c % 8 < 7 && c / 8 < 7 ? TexelGrid::kWhole : 0);
  }
  TexelGrid grid() const { return {cells.data(), &triangle, 8}; }
};

// Over many u, the four texels around a point come up with their bilinear weights.
TEST(Kernels, LookUpPicksByBilinearWeight) {
  const SmallPage page;
  for (const InstructionSet set : available()) {
    int counts[64] = {};
    constexpr int kRounds = 256;
    for (int round = 0; round < kRounds; ++round) {
      std::uint32_t triangle[16] = {}, back[16] = {}, hit[16];
      float bu[16], bv[16], u[16];
      for (int i = 0; i < 16; ++i) {
        bu[i] = 3.75f / 8, bv[i] = 2.9f / 8;  // fx = 0.25, fy = 0.4 in the block at (3, 2)
        u[i] = (float(round * 16 + i) + 0.5f) / (kRounds * 16);
      }
      kernels(set).look_up(page.grid(), triangle, bu, bv, back, u, hit);
      for (int i = 0; i < 16; ++i) {
        ASSERT_LT(hit[i], 64u);
        ++counts[hit[i]];
      }
    }
    const double n = kRounds * 16;
    EXPECT_NEAR(counts[2 * 8 + 3] / n, 0.75 * 0.6, 2e-3);
    EXPECT_NEAR(counts[2 * 8 + 4] / n, 0.25 * 0.6, 2e-3);
    EXPECT_NEAR(counts[3 * 8 + 3] / n, 0.75 * 0.4, 2e-3);
    EXPECT_NEAR(counts[3 * 8 + 4] / n, 0.25 * 0.4, 2e-3);
  }
}

TEST(Kernels, LookUpTellsSkyBacksAndRims) {
  SmallPage page;
  const std::uint32_t triangle[16] = {0xffffffffu};
  std::uint32_t back[16] = {}, hit[16];
  float bu[16] = {}, bv[16] = {};
  const float u[16] = {};
  back[1] = 1;
  bu[2] = 7.8f / 8;  // the last column has no right neighbor
  bu[3] = bv[3] = 3.0f / 8;
  bu[4] = -0.01f;  // outside the page
  for (const InstructionSet set : available()) {
    kernels(set).look_up(page.grid(), triangle, bu, bv, back, u, hit);
    EXPECT_EQ(hit[0], kHitSky);
    EXPECT_EQ(hit[1], kHitNothing);
    EXPECT_EQ(hit[2], kHitUnclear);
    EXPECT_LT(hit[3], 64u);
    EXPECT_EQ(hit[4], kHitUnclear);
  }
  page.triangle.double_sided = 1;  // double-sided: the back's own texel is not the kernel's to find
  kernels().look_up(page.grid(), triangle, bu, bv, back, u, hit);
  EXPECT_EQ(hit[1], kHitUnclear);
}

/// Patches about the origin with normals of all kinds, some of them at one place.
struct Surfaces {
  static constexpr std::uint32_t kCount = 256;

  std::vector<float> values = std::vector<float>(11 * kCount);
  std::vector<std::int32_t> places = std::vector<std::int32_t>(3 * kCount);

  Surfaces() {
    for (std::uint32_t i = 0; i < kCount; ++i) {
      for (std::uint32_t k = 0; k < 9; ++k)
        values[k * kCount + i] = sampling::to_unit(sampling::hash(i % 250, k)) - 0.5f;
      for (std::uint32_t k = 9; k < 11; ++k)
        values[k * kCount + i] = 0.01f + sampling::to_unit(sampling::hash(i, k));
      places[i] = std::int32_t(i % 3), places[kCount + i] = std::int32_t(i % 16);
      places[2 * kCount + i] = std::int32_t(i / 16);
    }
  }
  PatchColumns columns() const {
    const auto column = [&](std::size_t k) { return values.data() + k * kCount; };
    return {{column(0), column(1), column(2)},
            {column(3), column(4), column(5)},
            {column(6), column(7), column(8)},
            column(9),
            column(10),
            places.data(),
            places.data() + kCount,
            places.data() + 2 * kCount};
  }
  math::Vec3 get(std::uint32_t first, std::uint32_t i) const {
    return {values[first * kCount + i], values[(first + 1) * kCount + i],
            values[(first + 2) * kCount + i]};
  }
  float area(std::uint32_t i) const { return values[9 * kCount + i]; }
  float visible(std::uint32_t i) const { return values[10 * kCount + i]; }
  std::int32_t place(std::uint32_t k, std::uint32_t i) const { return places[k * kCount + i]; }
};
constexpr ExchangeRule kRule{3, 0.5f, 3};

// F = scale v v' A' cosθ cosθ'/r², at most 1 and A'/A; nothing for those that turn away, that are
// at one place, or within the window of a chart.
TEST(Kernels, ExchangeIsTheViewFactorOfPatches) {
  const Surfaces s;
  std::uint32_t faces = 0, held = 0, excluded = 0;
  for (std::uint32_t i = 0; i < 250; ++i) {
    for (std::uint32_t first = 0; first < Surfaces::kCount; first += 16) {
      Exchange e;
      kernels().exchange(s.columns(), i, s.columns(), first, kRule, e);
      for (std::uint32_t lane = 0; lane < 16; ++lane) {
        const std::uint32_t j = first + lane;
        const math::Vec3 way = s.get(0, j) - s.get(0, i);
        const float r2 = dot(way, way);
        const bool is_excluded = s.place(0, i) == s.place(0, j) &&
                                 std::abs(s.place(1, i) - s.place(1, j)) < kRule.window &&
                                 std::abs(s.place(2, i) - s.place(2, j)) < kRule.window;
        const bool turns = !(dot(s.get(3, i), way) > 0 && dot(s.get(3, j), way) < 0);
        excluded += is_excluded && !turns;
        const bool meets = r2 > 0 && !turns && !is_excluded;
        const float worth = kRule.scale * (s.visible(i) * s.visible(j));
        const auto factor = [&](float here, float there, float a, float other) {
          if (!meets) return 0.f;
          const float whole = here / r2 * (there / r2) * worth * other;
          held += whole > std::min(1.f, other / a);
          return std::min(whole, std::min(1.f, other / a));
        };
        const float forth = factor(std::max(0.f, dot(s.get(6, i), way)), -dot(s.get(3, j), way),
                                   s.area(i), s.area(j));
        const float back = factor(std::max(0.f, -dot(s.get(6, j), way)), dot(s.get(3, i), way),
                                  s.area(j), s.area(i));
        ASSERT_EQ(e.forth[lane], forth);
        ASSERT_EQ(e.back[lane], back);
        ASSERT_EQ(e.gives >> lane & 1, forth > 0);
        ASSERT_EQ(e.takes >> lane & 1, back > 0);
        ASSERT_EQ(e.near >> lane & 1, r2 < kRule.near_widths2 * std::max(s.area(i), s.area(j)));
        faces += meets;
      }
    }
  }
  EXPECT_GT(faces, 10'000u);
  EXPECT_GT(held, 100u);
  EXPECT_GT(excluded, 100u);
}

// A piece is left out at either end. What is shorter than two of them is no ray, and is finite.
TEST(Kernels, SegmentsAreShortenedAtBothEnds) {
  float from[3][16], to[3][16];
  for (std::uint32_t i = 0; i < 16; ++i)
    for (std::uint32_t k = 0; k < 3; ++k) {
      from[k][i] = sampling::to_unit(sampling::hash(i, k)) * 100 - 50;
      to[k][i] = i == 3 ? from[k][i] : sampling::to_unit(sampling::hash(i, k + 3)) * 100 - 50;
    }
  for (std::uint32_t k = 0; k < 3; ++k) to[k][5] = from[k][5] + 1e-4f;
  constexpr float kShare = 1e-3f, kLeast = 0.04f;
  SegmentRays rays;
  kernels().shorten(from, to, kLeast, kShare, rays);
  for (std::uint32_t i = 0; i < 16; ++i) {
    const math::Vec3 a{from[0][i], from[1][i], from[2][i]}, b{to[0][i], to[1][i], to[2][i]};
    const float piece = std::max(kLeast, kShare * std::max(max_abs(a), max_abs(b)));
    const math::Vec3 origin{rays.origin[0][i], rays.origin[1][i], rays.origin[2][i]};
    const math::Vec3 way{rays.direction[0][i], rays.direction[1][i], rays.direction[2][i]};
    ASSERT_EQ(rays.valid[i], i != 3 && i != 5 ? -1 : 0);
    ASSERT_TRUE(std::isfinite(max_abs(origin)) && std::isfinite(rays.far[i]));
    if (i == 3 || i == 5) continue;
    EXPECT_NEAR(length(origin - a), piece, 1e-4f);
    EXPECT_NEAR(length(b - (origin + way * rays.far[i])), piece, 1e-4f);
  }
}

TEST(Kernels, PairsHaveTheSameBitsInEveryInstructionSet) {
  const Surfaces points;
  const Kernels& plain = kernels(InstructionSet::kSse2);
  float from[3][16], to[3][16];
  std::copy_n(points.values.data(), 48, from[0]);
  std::copy_n(points.values.data() + 100, 48, to[0]);
  SegmentRays rays;
  plain.shorten(from, to, 1e-4f, 1e-5f, rays);
  for (const InstructionSet set : available()) {
    SegmentRays r;
    kernels(set).shorten(from, to, 1e-4f, 1e-5f, r);
    EXPECT_EQ(std::memcmp(&r, &rays, sizeof r), 0) << kernels(set).name;
    for (std::uint32_t first = 0; first + 16 <= Surfaces::kCount; first += 7) {
      Exchange all{}, e{};
      plain.exchange(points.columns(), 8, points.columns(), first, kRule, all);
      kernels(set).exchange(points.columns(), 8, points.columns(), first, kRule, e);
      EXPECT_EQ(std::memcmp(&e, &all, sizeof e), 0) << kernels(set).name;
    }
  }
}

}  // namespace
}  // namespace kiln::simd
