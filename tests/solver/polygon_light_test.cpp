#include "baker/solver/direct/polygon_light.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "baker/sampling/shapes.h"
#include "tests/support/quad_scene.h"

namespace kiln::solver {
namespace {

proto::SolverSettings direct_light(std::uint32_t shadow_rays) {
  proto::SolverSettings s;
  s.bounces = 0;
  s.direct_samples = shadow_rays;
  return s;
}

/// A floor of 4 m below a lamp of 1 m in 2 m height; the caller hangs things between.
class UnderALamp {
 public:
  UnderALamp() { floor = scene.add({{-2, 0, -2}, {0, 0, 4}, {4, 0, 0}}); }

  QuadScene scene{64};
  std::uint32_t floor = 0;

  void hang(math::Vec3 corner, math::Vec3 u, math::Vec3 v) {
    Quad quad{corner, u, v};
    quad.double_sided = true;
    scene.add(quad);
  }
  void light() {
    scene.build();
    scene.scene().rect_lights.push_back({{-0.5f, 2, -0.5f}, {1, 0, 0}, {0, 0, 1}, {100, 100, 100}});
  }
  /// Shadow rays for each texel of the floor, where all texels get the same number.
  double rays_for_a_texel(std::uint32_t asked) const {
    const Solution s = scene.solve(direct_light(asked));
    return double(s.passes.at(0).rays) / double(scene.texels_of(floor).size());
  }
};

// With nothing in between, the closed form is the answer: no noise at any number of rays, whatever
// the seed, near lamp or far.
TEST(PolygonLight, IsExactWhereNothingIsInTheWay) {
  for (const float height : {0.05f, 0.4f, 3.f}) {
    QuadScene scene(32);
    const auto floor = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
    scene.build();
    const math::Vec3 a{-0.4f, height, -0.3f}, u{0.9f, 0, 0}, v{0, 0, 0.7f};
    scene.scene().rect_lights.push_back({a, u, v, {1, 1, 1}});
    const Solution solution = scene.solve(direct_light(16));
    const std::array<math::Vec3, 4> lamp{a, a + u, a + u + v, a + v};
    for (const std::uint32_t t : scene.texels_of(floor)) {
      double expected = 0;
      for (const atlas::SamplePoint& p : scene.texels().points_of(t))
        expected += sampling::polygon_irradiance(position_at(scene.scene(), p.triangle, p.bary()),
                                                 {0, 1, 0}, lamp) /
                    atlas::TextureGroup::kPointsPerTexel;
      ASSERT_NEAR(solution.light->irradiance(t).g, expected, 3e-5 * expected + 1e-6)
          << "lamp at " << height << ", texel " << t;
    }
  }
}

TEST(PolygonLight, SendsAQuarterOfItsRaysWhereTheyAgree) {
  UnderALamp open;
  open.light();
  EXPECT_DOUBLE_EQ(open.rays_for_a_texel(64), 16);
  EXPECT_DOUBLE_EQ(open.rays_for_a_texel(1024), 256);
  UnderALamp closed;
  closed.hang({-0.6f, 1.99f, -0.6f}, {1.2f, 0, 0}, {0, 0, 1.2f});  // right below the lamp
  closed.light();
  EXPECT_LT(closed.rays_for_a_texel(64), 32 * 2);  // the lid's two sides are texels as well
  UnderALamp half;
  half.hang({-0.5f, 1.2f, -0.5f}, {1, 0, 0}, {0, 0, 1});
  half.light();
  EXPECT_GT(half.rays_for_a_texel(64), 1.5 * open.rays_for_a_texel(64));
}

// What agreeing rays may miss: a wire across the lamp takes 2 % of its light on a strip of the
// floor. Means over seeds are held against one bake with 64 times as many rays.
TEST(PolygonLight, AThinWireIsFoundInTheMean) {
  UnderALamp wired;
  wired.hang({-2, 1, -0.01f}, {4, 0, 0}, {0, 0, 0.02f});
  wired.light();
  const auto floor = wired.scene.texels_of(wired.floor);
  const SeedStudy few(wired.scene, direct_light(64), 24, floor);
  const SeedStudy many(wired.scene, direct_light(4096), 2, floor);
  EXPECT_NEAR(few.area_mean / many.area_mean, 1,
              2e-4 + 4 * few.area_standard_error / many.area_mean);
  UnderALamp open;
  open.light();
  const double unshadowed =
      SeedStudy(open.scene, direct_light(64), 2, open.scene.texels_of(open.floor)).area_mean;
  EXPECT_LT(many.area_mean, 0.995 * unshadowed) << "the wire takes light that could be missed";
}

// The same at the worst place and size: the darkest texel below the wire.
TEST(PolygonLight, MissesLittleOfAThinWireAnywhere) {
  UnderALamp wired;
  wired.hang({-2, 1, -0.01f}, {4, 0, 0}, {0, 0, 0.02f});
  wired.light();
  const auto floor = wired.scene.texels_of(wired.floor);
  constexpr int kSeeds = 24;
  const SeedStudy few(wired.scene, direct_light(64), kSeeds, floor);
  const SeedStudy many(wired.scene, direct_light(4096), 2, floor);
  double worst = 0;
  for (std::size_t i = 0; i < floor.size(); ++i)
    worst = std::max(worst, std::abs(few.mean[i] / many.mean[i] - 1) -
                                4.5 * few.standard_error[i] / many.mean[i]);
  EXPECT_LT(worst, 0.01);
}

}  // namespace
}  // namespace kiln::solver
