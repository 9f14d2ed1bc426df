#include "baker/sampling/shapes.h"

#include <gtest/gtest.h>

#include <array>
#include <set>

#include "baker/sampling/sobol.h"
#include "baker/solver/footprint.h"

namespace kiln::sampling {
namespace {

// Every elementary interval of volume 1/N holds one of the first N points, scrambled or not: the
// definition of a (0,m,2)-net.
TEST(Sobol, ScrambledPrefixIsANet) {
  for (const std::uint32_t seed : {1u, 77u, 0xdeadbeefu})
    for (int x_bits = 0; x_bits <= 8; ++x_bits) {
      std::set<std::pair<int, int>> cells;
      for (std::uint32_t i = 0; i < 256; ++i) {
        const math::Vec2 p = scrambled(sobol(i), seed);
        cells.insert({int(p.x * float(1 << x_bits)), int(p.y * float(1 << (8 - x_bits)))});
      }
      EXPECT_EQ(cells.size(), 256u) << "seed " << seed << ", split " << x_bits;
    }
}

TEST(Sobol, PaddedPairsAreNetsToo) {
  std::set<std::pair<int, int>> cells;
  for (std::uint32_t i = 0; i < 64; ++i) {
    const math::Vec2 p = sample_pair(i, 42);
    cells.insert({int(p.x * 8), int(p.y * 8)});
  }
  EXPECT_EQ(cells.size(), 64u);
}

// Two seeds are independent: the mean of the product of two coordinates is the product of the means
// up to the error of 4096 products, sigma = (1/12)/sqrt(4096); 4.9 sigma for a false alarm of 1e-6.
TEST(Sobol, SeedsDecorrelate) {
  double sum = 0;
  for (std::uint32_t seed = 0; seed < 4096; ++seed)
    sum += (double(sample_pair(3, hash(seed)).x) - 0.5) *
           (double(sample_pair(3, hash(seed + 100000)).x) - 0.5);
  EXPECT_NEAR(sum / 4096, 0, 4.9 / 12 / 64);
}

/// Root mean square error of the share of a lamp that a footprint sees past straight edges in any
/// direction, by `runs` samples of each of sixteen points; Footprint::sample_of() or the point's
/// own number says which run of the sequence a point takes.
double half_shadow_error(std::uint32_t runs, bool own_number) {
  constexpr int kEdges = 1000, kGrid = 64;
  double square = 0;
  for (std::uint32_t edge = 0; edge < kEdges; ++edge) {
    const auto random = [&](std::uint32_t d) { return to_unit(hash(edge, d)); };
    const float on_texel = 2 * math::kPi * random(1), on_lamp = 2 * math::kPi * random(2);
    const math::Vec2 a{std::cos(on_texel), std::sin(on_texel)},
        b{std::cos(on_lamp), std::sin(on_lamp)};
    const float limit = 2 * random(3) - 0.5f;
    double sampled = 0, truth = 0;
    for (std::uint32_t i = 0; i < 16; ++i) {
      const math::Vec2 p = scrambled(sobol(i), hash(edge, 4));
      const float at = a.x * p.x + a.y * p.y;
      const std::uint32_t lane = i ^ hash(edge, 5) % 16;
      const std::uint32_t run = own_number ? lane : solver::Footprint::sample_of(lane);
      for (std::uint32_t k = 0; k < runs; ++k) {
        const math::Vec2 q = scrambled(sobol(run * runs + k), hash(edge, 6));
        sampled += at + b.x * q.x + b.y * q.y > limit ? 1. / (16 * runs) : 0;
      }
      for (int k = 0; k < kGrid * kGrid; ++k) {
        const float x = (float(k % kGrid) + 0.5f) / kGrid, y = (float(k / kGrid) + 0.5f) / kGrid;
        truth += at + b.x * x + b.y * y > limit ? 1. / (16 * kGrid * kGrid) : 0;
      }
    }
    square += (sampled - truth) * (sampled - truth) / kEdges;
  }
  return std::sqrt(square);
}

TEST(Footprint, EdgesAcrossTexelAndLampAreMetAtDifferentPoints) {
  for (const std::uint32_t runs : {1u, 4u})
    EXPECT_LT(half_shadow_error(runs, false), 0.85 * half_shadow_error(runs, true)) << runs;
  std::set<std::uint32_t> samples;
  for (std::uint32_t i = 0; i < 16; ++i) samples.insert(solver::Footprint::sample_of(i));
  EXPECT_EQ(samples.size(), 16u);
  EXPECT_EQ(*samples.rbegin(), 15u);
}

TEST(Frame, IsOrthonormalForAllNormals) {
  for (const math::Vec3 n :
       {math::Vec3{0, 0, 1}, math::Vec3{0, 0, -1}, normalize(math::Vec3{1, -2, 3}),
        normalize(math::Vec3{1e-4f, 1e-4f, -1})}) {
    const Frame f(n);
    EXPECT_NEAR(dot(f.x, f.y), 0, 1e-6);
    EXPECT_NEAR(dot(f.x, n), 0, 1e-6);
    EXPECT_NEAR(dot(f.y, n), 0, 1e-6);
    EXPECT_NEAR(length(f.x), 1, 1e-6);
    EXPECT_NEAR(dot(cross(f.x, f.y), n), 1, 1e-6);
  }
}

// For density cosθ/π: E[cosθ] = 2/3, E[cos²θ] = 1/2, and no direction is favored around the axis.
TEST(CosineDirection, HasTheMomentsOfACosine) {
  constexpr std::uint32_t kN = 65536;
  double z = 0, z2 = 0, x = 0, y = 0, x2 = 0;
  for (std::uint32_t i = 0; i < kN; ++i) {
    const math::Vec3 d = cosine_direction(scrambled(sobol(i), 9));
    EXPECT_NEAR(length(d), 1, 1e-5);
    z += d.z, z2 += double(d.z) * d.z, x += d.x, y += d.y, x2 += double(d.x) * d.x;
  }
  EXPECT_NEAR(z / kN, 2.0 / 3, 1e-4);  // QMC error about 1/N
  EXPECT_NEAR(z2 / kN, 0.5, 1e-4);
  EXPECT_NEAR(x / kN, 0, 1e-4);
  EXPECT_NEAR(y / kN, 0, 1e-4);
  EXPECT_NEAR(x2 / kN, 0.25, 1e-4);
}

// One octant: solid angle π/2, and by symmetry the mean direction has three equal components, each
// the projected area of the octant on a coordinate plane over π/2: (π/4)/(π/2) = 1/2.
TEST(SphericalTriangle, OctantHasKnownAreaAndMean) {
  const SphericalTriangle octant({0, 0, 0}, {2, 0, 0}, {0, 3, 0}, {0, 0, 4});
  EXPECT_NEAR(octant.solid_angle, math::kPi / 2, 1e-5);
  constexpr std::uint32_t kN = 16384;
  std::array<double, 3> mean{};
  for (std::uint32_t i = 0; i < kN; ++i) {
    const math::Vec3 d = octant.sample(scrambled(sobol(i), 5));
    ASSERT_GE(std::min({d.x, d.y, d.z}), -1e-5f) << "outside the triangle";
    mean[0] += d.x, mean[1] += d.y, mean[2] += d.z;
  }
  for (double m : mean) EXPECT_NEAR(m / kN, 0.5, 2e-4);
}

// Uniform solid angle, weighted by the cosine, must integrate to Lambert's closed form.
TEST(SphericalTriangle, MeanCosineAgreesWithLambert) {
  const math::Vec3 p{0.2f, 0.1f, 0}, n{0, 0, 1};
  const math::Vec3 a{-0.5f, 0.3f, 0.6f}, b{1.2f, -0.4f, 0.5f}, c{0.3f, 0.9f, 1.1f};
  const SphericalTriangle t(p, a, b, c);
  constexpr std::uint32_t kN = 16384;
  double sum = 0;
  for (std::uint32_t i = 0; i < kN; ++i) sum += dot(t.sample(scrambled(sobol(i), 3)), n);
  EXPECT_NEAR(sum / kN * t.solid_angle,
              polygon_irradiance(p, n, std::array<math::Vec3, 3>{a, b, c}), 2e-4);
}

TEST(SphericalTriangle, SmallTriangleTendsToItsFlatArea) {
  const SphericalTriangle t({0, 0, 0}, {0, 0, 10}, {0.01f, 0, 10}, {0, 0.01f, 10});
  EXPECT_NEAR(t.solid_angle / (0.5e-4 / 100), 1, 2e-2);  // float: 7 digits on unit vectors
}

// A square of side 2 at distance 1, parallel, centered: F = 4 · F of one quadrant, which is
// 1/(2π) · 2 · (X/√(1+X²)) · atan(Y/√(1+X²)) with X = Y = 1 [Howell, configuration B-4].
TEST(TriangleIrradiance, ParallelSquareOverAPoint) {
  const double x = 1 / std::sqrt(2.0);
  const double factor = 4 * (1 / (2 * double(math::kPi))) * 2 * x * std::atan(x);
  const math::Vec3 a{-1, -1, 1}, b{1, -1, 1}, c{1, 1, 1}, d{-1, 1, 1};
  const math::Vec3 p, n{0, 0, 1};
  const float e = polygon_irradiance(p, n, std::array<math::Vec3, 3>{a, b, c}) +
                  polygon_irradiance(p, n, std::array<math::Vec3, 3>{a, c, d});
  EXPECT_NEAR(e / math::kPi, factor, 1e-5);
}

// Half of a triangle that is symmetric about the horizon plane counts, the other half is below.
TEST(TriangleIrradiance, ClipsAtTheHorizon) {
  const math::Vec3 p, n{0, 0, 1};
  const float whole = polygon_irradiance(
      p, n,
      std::array<math::Vec3, 3>{math::Vec3{1, -1, -1}, math::Vec3{1, 1, -1}, math::Vec3{1, 0, 1}});
  // The part above z = 0 is the triangle that the cut leaves.
  const float above =
      polygon_irradiance(p, n,
                         std::array<math::Vec3, 3>{math::Vec3{1, -0.5f, 0}, math::Vec3{1, 0.5f, 0},
                                                   math::Vec3{1, 0, 1}});
  EXPECT_NEAR(whole, above, 1e-6);
  EXPECT_GT(whole, 0);
  EXPECT_EQ(polygon_irradiance(p, n,
                               std::array<math::Vec3, 3>{math::Vec3{1, 0, -1}, math::Vec3{0, 1, -1},
                                                         math::Vec3{-1, -1, -1}}),
            0);
}

}  // namespace
}  // namespace kiln::sampling
