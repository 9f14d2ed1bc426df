// Gather against the unbiased path method on scenes of every kind of light.
#include <gtest/gtest.h>

#include "baker/methods.h"
#include "baker/solve.h"
#include "tests/support/ready_scene.h"
#include "tests/support/sanitizer.h"

namespace kiln::solver {
namespace {

struct Case {
  const char* scene;
  math::Rgb sky;
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.scene;
}

class Scenes : public testing::TestWithParam<Case> {};

struct Baked {
  std::vector<math::Rgb> light;
  double told = 0;  ///< root mean square of the standard error that the samples tell, luminance
};

Baked bake(const test::ReadyScene& ready, const proto::SolverSettings& settings) {
  const World world = ready.world(settings);
  const auto solver = baker::make_solver(world);
  exec::ThreadPool pool(2);
  const auto solution = baker::solve(world, *solver, pool, {});
  if (!solution) throw std::logic_error(solution.error().message);
  const lightmap::Lightmap& light = *solution->light;
  Baked baked;
  double square = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t) {
    baked.light.push_back(light.irradiance(t));
    square += std::pow(double(light.direct_difference[t]), 2) +
              std::pow(double(light.sky_difference[t] + light.indirect_difference[t]), 2);
  }
  baked.told = std::sqrt(square / light.size());
  return baked;
}

double sum(math::Rgb v) {
  return double(v.r) + v.g + v.b;
}

// The limit of a gather is unbiased but for the interpolation of the radiosity that its rays read.
// The mean over the surface, and texel by texel with the references' noise taken out by having two
// of them: (x - r1)(x - r2).
TEST_P(Scenes, GatherMeetsPath) {
  const Case& c = GetParam();
  proto::BakeSettings settings;
  settings.sky.radiance = {c.sky.r, c.sky.g, c.sky.b};
  const test::ReadyScene ready(c.scene, 24, 64, settings);
  proto::SolverSettings path;
  path.method = proto::Method::kPath;
  path.samples = 256 / test::kSlowdown;
  path.bounces = 6;
  const auto r1 = bake(ready, path).light;
  path.seed = 2;
  const auto r2 = bake(ready, path).light;
  proto::SolverSettings gather;
  gather.samples = gather.direct_samples = 512 / test::kSlowdown;
  gather.bounces = path.bounces;
  gather.coarse_indirect = false;
  const Baked baked = bake(ready, gather);
  const std::vector<math::Rgb>& x = baked.light;

  double area = 0, mean = 0, bias = 0, square = 0, noise = 0, plain_mean = 0;
  for (std::uint32_t t = 0; t < x.size(); ++t) {
    const double a = ready.texels.area_m2[t], r = sum(r1[t] + r2[t]) / 2;
    area += a, mean += a * r, bias += a * (sum(x[t]) - r);
    noise += a * a * std::pow(sum(r1[t] - r2[t]) / 2, 2);  // variance of r, texel by texel
    const math::Rgb d = (x[t] - r1[t]) * (x[t] - r2[t]);
    square += sum(d) / 3 / double(x.size());
    plain_mean += r / 3 / double(x.size());
  }
  ASSERT_GT(mean, 0);
  const double relative_bias = bias / mean, uncertain = std::sqrt(noise) / mean;
  RecordProperty("bias_percent", std::to_string(100 * relative_bias));
  EXPECT_LT(uncertain, 0.0015 * std::sqrt(test::kSlowdown))
      << "the references must be better than what they judge";
  EXPECT_LE(std::abs(relative_bias), 0.005 + 3 * uncertain);
  const double nrmse = std::sqrt(std::max(0.0, square)) / plain_mean;
  RecordProperty("nrmse_percent", std::to_string(100 * nrmse));
  // Its own noise, and on a page of 64² the coarse radiosity that it reads, and the hard shadows of
  // sixteen points.
  EXPECT_LE(nrmse, 0.015 + 1.5 * baked.told / plain_mean);
}

INSTANTIATE_TEST_SUITE_P(OfEveryLight, Scenes,
                         testing::Values(Case{"cornell", {}}, Case{"courtyard", {2, 3, 5}},
                                         Case{"room_textured", {}}, Case{"many_lights", {}},
                                         Case{"sphere_on_plane", {1, 1, 1}},
                                         Case{"plane_sun", {100, 120, 150}}, Case{"colour_box", {}},
                                         Case{"furnace_90", {}}),
                         [](const auto& c) { return std::string(c.param.scene); });

}  // namespace
}  // namespace kiln::solver
