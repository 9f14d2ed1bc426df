// What the techniques that can be left out (solver.without) are worth, and that the light is the
// same without them.
#include <gtest/gtest.h>

#include "tests/solver/cornell_box.h"

namespace kiln::solver {
namespace {

using proto::Technique;

/// Fixed samples, so that nothing makes up for what is left out.
proto::SolverSettings fixed(std::uint32_t samples, std::vector<Technique> without = {}) {
  proto::SolverSettings s;
  s.samples = s.direct_samples = samples;
  s.coarse_indirect = false;
  s.bounces = 1;
  s.without = std::move(without);
  return s;
}

double mean(const lightmap::Plane<math::Rgb>& light) {
  double sum = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t) sum += light[t].g;
  return sum / double(light.size());
}

/// A hall of 100 small lamps, a quarter of them hidden from the floor by a shelf.
std::unique_ptr<QuadScene> hall() {
  auto hall = std::make_unique<QuadScene>(256);
  const math::Rgb gray{0.5f, 0.5f, 0.5f};
  hall->add({{-5, 0, -5}, {0, 0, 10}, {10, 0, 0}, gray});
  hall->add({{-5, 2.5f, -5}, {2.5f, 0, 0}, {0, 0, 10}, gray});
  for (int i = 0; i < 100; ++i)
    hall->add({{-4.5f + float(i % 10), 3, -4.5f + float(i / 10)},
               {0.1f, 0, 0},
               {0, 0, 0.1f},
               {},
               {50, 50, 50}});
  hall->build();
  return hall;
}

TEST(Techniques, LowDiscrepancyMakesErrorsFallFaster) {
  const auto box = cornell(64);
  const std::vector<Technique> random{Technique::kLowDiscrepancy};
  const double few = scatter(*box, fixed(64, random), &lightmap::Lightmap::indirect);
  const double many = scatter(*box, fixed(256, random), &lightmap::Lightmap::indirect);
  EXPECT_NEAR(many / few, 0.5, 0.05) << "random points: N^-1/2";
  EXPECT_LT(scatter(*box, fixed(256), &lightmap::Lightmap::indirect), many / 2);
  EXPECT_LT(scatter(*box, fixed(256), &lightmap::Lightmap::direct),
            scatter(*box, fixed(256, random), &lightmap::Lightmap::direct));
  const auto sampled = box->solve(fixed(256, random)), net = box->solve(fixed(256));
  const double error = few / 2 / std::sqrt(double(box->texels().size()));
  // Bounces carry errors on: a few standard errors.
  EXPECT_NEAR(mean(sampled.light->indirect) / mean(net.light->indirect), 1, 10 * error);
}

TEST(Techniques, TheClosedFormLeavesNoiseInHalfShadowsOnly) {
  const auto box = cornell(64);
  const std::vector<Technique> sampled{Technique::kClosedForm};
  const double without = scatter(*box, fixed(256, sampled), &lightmap::Lightmap::direct);
  EXPECT_LT(scatter(*box, fixed(256), &lightmap::Lightmap::direct), without / 1.2);
  EXPECT_NEAR(mean(box->solve(fixed(256, sampled)).light->direct) /
                  mean(box->solve(fixed(256)).light->direct),
              1, 0.002);
}

TEST(Techniques, ImportanceChoosesAmongManyLights) {
  const auto scene = hall();
  const std::vector<Technique> by_power{Technique::kLightImportance};
  const double without = scatter(*scene, fixed(64, by_power), &lightmap::Lightmap::direct);
  EXPECT_LT(scatter(*scene, fixed(64), &lightmap::Lightmap::direct), without / 1.5);
  const double error = without / 2 / std::sqrt(double(scene->texels().size()));
  EXPECT_NEAR(mean(scene->solve(fixed(256, by_power)).light->direct) /
                  mean(scene->solve(fixed(256)).light->direct),
              1, 10 * error);
}

TEST(Techniques, ProbesSaveShadowRays) {
  const auto box = cornell(64);
  const std::vector<Technique> all{Technique::kShadowProbes};
  const auto rays = [](const Solution& s) { return s.passes.front().rays; };
  const Solution probed = box->solve(fixed(64)), sent = box->solve(fixed(64, all));
  EXPECT_LT(double(rays(probed)), 0.7 * double(rays(sent)));
  EXPECT_NEAR(mean(probed.light->direct) / mean(sent.light->direct), 1, 0.001);
  EXPECT_NEAR(scatter(*box, fixed(64), &lightmap::Lightmap::direct) /
                  scatter(*box, fixed(64, all), &lightmap::Lightmap::direct),
              1, 0.15);
}

}  // namespace
}  // namespace kiln::solver
