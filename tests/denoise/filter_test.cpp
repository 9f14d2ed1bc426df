// The filter bank: what it must leave alone, what it must lower, and what it says of the error.
#include "baker/denoise/filter_bank.h"
#include "baker/methods.h"

#include <gtest/gtest.h>

#include <random>

#include "baker/denoise/surface_neighbors.h"
#include "baker/solve.h"
#include "baker/solver/work.h"
#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::denoise {
namespace {

/// Two squares of 2 m that make one floor, a wall on one of them, and nothing else.
std::unique_ptr<solver::QuadScene> floors() {
  auto scene = std::make_unique<solver::QuadScene>(96);
  const math::Rgb gray{0.5f, 0.5f, 0.5f};
  scene->add({{0, 0, 0}, {0, 0, 2}, {2, 0, 0}, gray});
  scene->add({{2, 0, 0}, {0, 0, 2}, {2, 0, 0}, gray});
  scene->add({{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, gray});
  scene->build();
  return scene;
}

TEST(SurfaceNeighbors, GoOnBehindTheEdgeOfAChart) {
  const auto scene = floors();
  const atlas::TextureGroup& texels = scene->texels();
  SurfaceNeighbors neighbors(texels);
  exec::ThreadPool pool(2);
  ASSERT_TRUE(neighbors.link({pool, {}}));
  const auto floor = scene->texels_of(0);
  const float side = std::sqrt(texels.area_m2[floor[floor.size() / 2]]);
  std::uint32_t across = 0, edge = 0;
  for (const std::uint32_t t : floor) {
    const auto around = neighbors.of(t);
    EXPECT_EQ(around[SurfaceNeighbors::kSelf], std::int32_t(t));
    for (const std::int32_t n : around) {
      if (n == atlas::kNoTexel) continue;
      EXPECT_NE(texels.triangle[n] / 2, 2u) << "a wall is no neighbor of the floor";
      across += texels.triangle[n] / 2 == 1;
      EXPECT_LT(length(texels.position[n] - texels.position[t]), 4.5f * side);
    }
    edge += texels.position[t].x > 2 - side;
  }
  EXPECT_GT(edge, 10u);
  EXPECT_GE(across, 5 * edge) << "each texel at the seam sees two columns of five behind it";
}

/// A light with independent noise of standard deviation `sigma` in each half of the samples.
lightmap::Lightmap noisy(const atlas::TextureGroup& texels, float sigma,
                         const std::function<float(math::Vec3)>& truth) {
  std::mt19937 random(7);
  std::normal_distribution<float> normal(0, sigma);
  lightmap::Lightmap light(texels.size());
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    const float e = truth(texels.position[t]);
    const float a = e + normal(random), b = e + normal(random);
    const math::Rgb mean{(a + b) / 2, (a + b) / 2, (a + b) / 2};
    light.indirect[t] = light.direct[t] = mean;
    light.indirect_difference[t] = light.direct_difference[t] = (a - b) / 2;
  }
  return light;
}

struct Errors {
  double before = 0, after = 0, told = 0;  ///< root mean squares
};
Errors errors_of(const atlas::TextureGroup& texels, const lightmap::Lightmap& light,
                 const FilteredLight& shown, const std::function<float(math::Vec3)>& truth) {
  Errors e;
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    const double x = truth(texels.position[t]);
    e.before += (light.indirect[t].g - x) * (light.indirect[t].g - x);
    e.after += (shown.indirect[t].g - x) * (shown.indirect[t].g - x);
    e.told += double(shown.gathered_variance[t]);
  }
  for (double* v : {&e.before, &e.after, &e.told}) *v = std::sqrt(*v / texels.size());
  return e;
}

FilteredLight run(const atlas::TextureGroup& texels, const lightmap::Lightmap& light, bool smooth,
                  unsigned threads = 2) {
  exec::ThreadPool pool(threads);
  auto shown = FilterBank(texels, {}, smooth).run(light, {pool, {}});
  EXPECT_TRUE(shown);
  return std::move(*shown);
}

TEST(FilterBank, LowersTheNoiseOfSmoothLightAndKnowsWhatIsLeft) {
  const auto scene = floors();
  const auto truth = [](math::Vec3 p) { return 10 + p.x + 2 * p.y; };
  const lightmap::Lightmap light = noisy(scene->texels(), 1, truth);
  const Errors e = errors_of(scene->texels(), light, run(scene->texels(), light, true), truth);
  EXPECT_NEAR(e.before, 1 / std::sqrt(2.0), 0.03);
  EXPECT_LT(e.after, 0.35 * e.before);
  EXPECT_GT(e.told, 0.6 * e.after);
  EXPECT_LT(e.told, 2 * e.after);
}

TEST(FilterBank, LeavesAnEdgeThatTheHalvesAgreeOn) {
  const auto scene = floors();
  const auto truth = [](math::Vec3 p) { return p.x < 1 ? 10.f : 20.f; };
  const lightmap::Lightmap light = noisy(scene->texels(), 0.05f, truth);
  const Errors e = errors_of(scene->texels(), light, run(scene->texels(), light, true), truth);
  EXPECT_LT(e.after, 1.05 * e.before);
}

TEST(FilterBank, LightWithoutNoiseKeepsItsBitsButForRounding) {
  const auto scene = floors();
  const auto truth = [](math::Vec3 p) {
    return 5 + 3 * std::sin(4 * p.x) * std::cos(3 * p.z + p.y);
  };
  const lightmap::Lightmap light = noisy(scene->texels(), 0, truth);
  const FilteredLight shown = run(scene->texels(), light, true);
  for (std::uint32_t t = 0; t < light.size(); ++t)
    ASSERT_NEAR(shown.indirect[t].g, light.indirect[t].g, 2e-4f * light.indirect[t].g);
}

TEST(FilterBank, WithoutSmoothingTheVarianceIsThatOfTheMean) {
  const auto scene = floors();
  const auto truth = [](math::Vec3) { return 3.f; };
  const lightmap::Lightmap light = noisy(scene->texels(), 0.2f, truth);
  const FilteredLight shown = run(scene->texels(), light, false);
  const Errors e = errors_of(scene->texels(), light, shown, truth);
  EXPECT_EQ(e.after, e.before);
  // Thousands of texels, a few percent.
  EXPECT_NEAR(e.told, e.before, 0.05 * e.before);
}

TEST(FilterBank, DarkStaysDark) {
  const auto scene = floors();
  const lightmap::Lightmap light(scene->texels().size());
  const FilteredLight shown = run(scene->texels(), light, true);
  for (std::uint32_t t = 0; t < light.size(); ++t) {
    ASSERT_TRUE(is_black(shown.direct[t]) && is_black(shown.sky[t]) && is_black(shown.indirect[t]));
    ASSERT_EQ(shown.gathered_variance[t], 0);
  }
}

// What a bake says of its error is its error: root mean squares against a far better bake.
TEST(StandardError, IsThatOfTheBake) {
  solver::QuadScene room(96);
  room.add_room({0, 0, 0}, {2, 2, 2}, {0.6f, 0.5f, 0.4f});
  room.add_block({0.5f, 0, 0.5f}, {1, 1, 1}, {0.7f, 0.7f, 0.7f});
  room.add({{0.8f, 1.99f, 0.8f}, {0.4f, 0, 0}, {0, 0, 0.4f}, {}, {10, 10, 10}});
  room.build();
  proto::SolverSettings fine;
  fine.samples = 2048;
  fine.direct_samples = 2048;
  fine.coarse_indirect = false;
  fine.seed = 9;
  const solver::Solution truth = room.solve(fine);
  double mean = 0;
  for (std::uint32_t t = 0; t < room.texels().front_count; ++t)
    mean += luminance(truth.light->irradiance(t)) / float(room.texels().front_count);
  for (const float target : {0.03f, 0.01f}) {
    const solver::Solution bake = room.solve({}, 2, {.target_error = target});
    const double told = bake.passes.back().standard_error.value();
    EXPECT_LE(told, target);
    double measured = 0, said = 0;
    for (std::uint32_t t = 0; t < room.texels().front_count; ++t) {
      const double e = luminance(truth.light->irradiance(t)), scale = e + 0.02 * mean;
      measured += std::pow((luminance(bake.irradiance(t)) - e) / scale, 2);
      said +=
          (bake.filtered.direct_variance[t] + bake.filtered.gathered_variance[t]) / (scale * scale);
    }
    const double ratio = std::sqrt(said / measured);
    RecordProperty("told_over_measured", std::to_string(ratio));
    EXPECT_GT(ratio, 0.6) << target;
    EXPECT_LT(ratio, 1.7) << target;
  }
}

// A hard target costs more samples, and only where they are needed.
TEST(AdaptiveSampling, SendsSamplesWhereTheErrorIs) {
  solver::QuadScene room(96);
  room.add_room({0, 0, 0}, {2, 2, 2}, {0.6f, 0.5f, 0.4f});
  room.add_block({0.5f, 0, 0.5f}, {1, 1, 1}, {0.7f, 0.7f, 0.7f});
  room.add({{0.8f, 1.99f, 0.8f}, {0.4f, 0, 0}, {0, 0, 0.4f}, {}, {10, 10, 10}});
  room.build();
  const solver::Solution bake = room.solve({}, 2, {.target_error = 0.009f});
  const auto [least, most] =
      std::minmax_element(bake.light->direct_samples.begin(), bake.light->direct_samples.end());
  EXPECT_EQ(*least, 64u) << "what is fully lit needs no more";
  EXPECT_GE(*most, 256u);
  const solver::Solution limited = room.solve({}, 2, {.target_error = 0.009f, .max_samples = 64});
  for (const std::uint32_t n : limited.light->direct_samples) ASSERT_LE(n, 64u);
  for (const std::uint32_t n : limited.light->samples) ASSERT_LE(n, 64u);
  EXPECT_GT(*limited.passes.back().standard_error, 0.009);
}

// Where the samples of a round go is known: half of its texels may be far from half of its work.
TEST(AdaptiveSampling, KnowsHowFarARoundHasCome) {
  const test::ReadyScene room("cornell", 0, 96);
  proto::SolverSettings settings;
  settings.coarse_indirect = false;
  const solver::World world = room.world(settings, {.target_error = 0.009f});
  const auto solver = baker::make_solver(world);
  const std::uint32_t half = room.texels.size() / 128 * 64;  // whole tiles
  std::shared_ptr<const lightmap::Lightmap> before;
  double told = 0, done = 0;
  baker::SolveHooks hooks;
  hooks.on_batch = [&](const baker::SolveProgress& at) {
    if (at.pass.plan().name == "round" && at.done == 1 && told == 0)
      told = at.pass.work_share(double(half) / room.texels.size());
  };
  hooks.on_pass = [&](const solver::PassPlan& pass, const proto::PassReport&,
                      std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
    if (pass.name == "round" && done == 0) {
      double work[2] = {0, 0};
      for (std::uint32_t t = 0; t < light->size(); ++t)
        work[t >= half] += (light->direct_samples[t] - before->direct_samples[t]) +
                           solver::work::kDirection * (light->samples[t] - before->samples[t]);
      done = work[0] / (work[0] + work[1]);
    }
    before = light;
    return {};
  };
  exec::ThreadPool pool(2);
  ASSERT_TRUE(baker::solve(world, *solver, pool, {}, hooks));
  EXPECT_GT(std::abs(done - 0.5), 0.1) << "or this would show nothing";
  EXPECT_NEAR(told, done, 0.01);  // the last tile is not whole
}

// A room with a lamp close above a block: what is bright makes the mean square, the dark does not.
class MeanSquare : public testing::Test {
 protected:
  void SetUp() override {
    room_.add_room({0, 0, 0}, {2, 2, 2}, {0.6f, 0.5f, 0.4f});
    room_.add_block({0.5f, 0, 0.5f}, {1.5f, 1.5f, 1.5f}, {0.7f, 0.7f, 0.7f});
    room_.add({{0.8f, 1.9f, 0.8f}, {0.4f, 0, 0}, {0, 0, 0.4f}, {}, {10, 10, 10}});
    room_.build();
  }
  double mean(const solver::Solution& bake) const {
    double sum = 0;
    for (std::uint32_t t = 0; t < room_.texels().front_count; ++t)
      sum += luminance(bake.irradiance(t));
    return sum / room_.texels().front_count;
  }
  static double rays(const solver::Solution& bake) {
    double sum = 0;
    for (const auto& p : bake.passes) sum += double(p.rays);
    return sum;
  }

  solver::QuadScene room_{96};
};

TEST_F(MeanSquare, IsWhatItIsToldToBe) {
  proto::SolverSettings fine;
  fine.samples = fine.direct_samples = 2048;
  fine.coarse_indirect = false;
  fine.seed = 9;
  const solver::Solution truth = room_.solve(fine);
  for (const float target : {0.04f, 0.015f}) {
    const solver::Solution bake =
        room_.solve({}, 2, {.measure = proto::ErrorMeasure::kRms, .target_error = target});
    const double told = bake.passes.back().standard_error.value();
    EXPECT_LE(told, target);
    double square = 0;
    for (std::uint32_t t = 0; t < room_.texels().front_count; ++t)
      square += std::pow(luminance(bake.irradiance(t)) - luminance(truth.light->irradiance(t)), 2);
    const double measured = std::sqrt(square / room_.texels().front_count) / mean(truth);
    RecordProperty("told_over_measured", std::to_string(told / measured));
    EXPECT_GT(told, 0.7 * measured) << target;  // interpolation is not told
    EXPECT_LT(told, 1.35 * measured) << target;
  }
}

TEST_F(MeanSquare, TakesFewerRaysThanTheSameSamplesForAll) {
  proto::SolverSettings even;
  even.samples = even.direct_samples = 256;
  even.coarse_indirect = false;
  const solver::Solution uniform = room_.solve(even, 2, {}, false);
  double square = 0;
  for (std::uint32_t t = 0; t < room_.texels().front_count; ++t)
    square += uniform.filtered.direct_variance[t] + uniform.filtered.gathered_variance[t];
  const auto error = float(std::sqrt(square / room_.texels().front_count) / mean(uniform));
  proto::SolverSettings s;
  s.coarse_indirect = false;
  const solver::Solution chosen =
      room_.solve(s, 2, {.measure = proto::ErrorMeasure::kRms, .target_error = error}, false);
  EXPECT_LE(*chosen.passes.back().standard_error, error);
  RecordProperty("share_of_rays", std::to_string(rays(chosen) / rays(uniform)));
  EXPECT_LT(rays(chosen), 0.85 * rays(uniform));
}

}  // namespace
}  // namespace kiln::denoise
