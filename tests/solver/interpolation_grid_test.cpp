#include "baker/solver/gather/interpolation_grid.h"

#include <gtest/gtest.h>

#include "tests/support/quad_scene.h"

namespace kiln::solver {
namespace {

QuadScene two_plates() {
  QuadScene scene(64);
  scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  scene.add({{-1, 1, -1}, {2, 0, 0}, {0, 0, 2}});
  scene.build();
  return scene;
}

TEST(InterpolationGrid, AreTheEvenTexelsOfTheSameChart) {
  const QuadScene scene = two_plates();
  const atlas::TextureGroup& t = scene.texels();
  const gather::InterpolationGrid coarse(t);
  int interpolated = 0;
  for (std::uint32_t i = 0; i < t.size(); ++i) {
    const gather::InterpolationGrid::Sites sites = coarse.around(i);
    const bool odd_x = t.x[i] % 2, odd_y = t.y[i] % 2;
    if (!odd_x && !odd_y) {
      EXPECT_EQ(sites.count, 0u);
      continue;
    }
    if (sites.count == 0) continue;
    ++interpolated;
    EXPECT_EQ(sites.count, odd_x && odd_y ? 4u : 2u);
    int sum_x = 0, sum_y = 0;
    for (const std::uint32_t s : sites.all()) {
      EXPECT_EQ(t.x[s] % 2 + t.y[s] % 2, 0);
      EXPECT_EQ(t.chart[s], t.chart[i]);
      sum_x += t.x[s], sum_y += t.y[s];
    }
    EXPECT_EQ(sum_x, int(sites.count) * t.x[i]) << "not around the texel";
    EXPECT_EQ(sum_y, int(sites.count) * t.y[i]);
  }
  EXPECT_GT(interpolated, int(t.size()) * 6 / 10);
}

TEST(InterpolationGrid, AgreeWithinSixPercentOfAllLight) {
  const QuadScene scene = two_plates();
  const gather::InterpolationGrid coarse(scene.texels());
  std::uint32_t texel = 0;
  while (coarse.around(texel).count != 2) ++texel;
  const gather::InterpolationGrid::Sites sites = coarse.around(texel);
  lightmap::Lightmap light(scene.texels().size());
  const auto set = [&](float first, float second, float direct) {
    light.indirect[sites.texel[0]] = {first, first, first};
    light.indirect[sites.texel[1]] = {second, second, second};
    for (const std::uint32_t s : sites.all()) light.direct[s] = {direct, direct, direct};
  };
  set(1, 1.1f, 0);
  EXPECT_TRUE(coarse.agree(sites, light));
  set(1, 1.2f, 0);
  EXPECT_FALSE(coarse.agree(sites, light));
  set(1, 1.2f, 1);
  EXPECT_TRUE(coarse.agree(sites, light)) << "little against the direct light";
  light.validity[sites.texel[1]] = 0.9f;
  EXPECT_FALSE(coarse.agree(sites, light)) << "partly hidden";
}

double rms_difference(const lightmap::Lightmap& a, const lightmap::Lightmap& b) {
  double sum = 0;
  for (std::uint32_t t = 0; t < a.size(); ++t) {
    const double d = double(a.indirect[t].g) - b.indirect[t].g;
    sum += d * d;
  }
  return std::sqrt(sum / a.size());
}

// Against the limit of the dense gather: half the rays or less, and no greater error.
TEST(InterpolationGrid, SaveRaysAndRaiseNoError) {
  QuadScene room(128);
  const math::Rgb white{0.7f, 0.7f, 0.7f};
  room.add_room({-1, 0, -1}, {1, 2, 1}, white);
  room.add_block({-0.6f, 0, -0.5f}, {-0.05f, 1.2f, 0.05f}, white);
  room.add({{-0.25f, 1.98f, -0.25f}, {0.5f, 0, 0}, {0, 0, 0.5f}, {}, {12, 12, 12}});
  room.build();
  proto::SolverSettings s;
  s.samples = 256;
  s.direct_samples = 64;
  const Solution coarse = room.solve(s);
  s.coarse_indirect = false;
  const Solution dense = room.solve(s);
  s.samples = 4096;
  s.seed = 2;
  const Solution limit = room.solve(s);
  const auto rays = [](const Solution& solution) {
    std::uint64_t sum = 0;
    for (const auto& p : solution.passes) sum += p.name == "direct" ? 0 : p.rays;
    return double(sum);
  };
  EXPECT_LT(rays(coarse), 0.5 * rays(dense));
  EXPECT_LT(rms_difference(*coarse.light, *limit.light),
            1.02 * rms_difference(*dense.light, *limit.light));
}

}  // namespace
}  // namespace kiln::solver
