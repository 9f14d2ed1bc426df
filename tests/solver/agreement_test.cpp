// The methods against each other, and against the laws of their own error.
#include <gtest/gtest.h>

#include "baker/methods.h"
#include "baker/solver/gather/gather.h"
#include "tests/solver/cornell_box.h"
#include "tests/solver/touching.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver {
namespace {

/// The irradiance of all texels, as sampled or as shown.
std::vector<math::Rgb> sampled(const Solution& s) {
  std::vector<math::Rgb> e(s.light->size());
  for (std::uint32_t t = 0; t < e.size(); ++t) e[t] = s.light->irradiance(t);
  return e;
}
std::vector<math::Rgb> shown(const Solution& s) {
  std::vector<math::Rgb> e(s.light->size());
  for (std::uint32_t t = 0; t < e.size(); ++t) e[t] = s.irradiance(t);
  return e;
}

/// nRMSE of `light` against the truth that two independent, unbiased references straddle: their own
/// noise cancels in mean((x - r1)(x - r2)).
double noise_free_nrmse(const std::vector<math::Rgb>& light, const std::vector<math::Rgb>& r1,
                        const std::vector<math::Rgb>& r2) {
  double square = 0, mean = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t) {
    const math::Rgb x = light[t], a = r1[t], b = r2[t];
    const math::Rgb d = (x - a) * (x - b);
    square += (double(d.r) + d.g + d.b) / 3;
    mean += (double(a.r) + a.g + a.b + b.r + b.g + b.b) / 6;
  }
  const auto n = double(light.size());
  return std::sqrt(std::max(0.0, square / n)) / (mean / n);
}

Solution path_reference(const QuadScene& scene, std::uint32_t samples, std::uint64_t seed) {
  proto::SolverSettings s;
  s.method = proto::Method::kPath;
  s.samples = samples;
  s.bounces = 16;
  s.seed = seed;
  return scene.solve(s);
}

TEST(Agreement, GatherMeetsPathOnTheCornellBox) {
  const auto box = cornell(128);
  const auto r1 = sampled(path_reference(*box, 256, 11)),
             r2 = sampled(path_reference(*box, 256, 12));
  const double adaptive = noise_free_nrmse(shown(box->solve({})), r1, r2);
  EXPECT_LE(adaptive, 0.01) << "the defaults";
  proto::SolverSettings s;
  s.samples = 256;
  s.direct_samples = 64;
  // Texels of a tile share the cells of their directions: a few seeds for a figure that stays.
  constexpr int kSeeds = 4;
  double square = 0;
  for (s.seed = 1; s.seed <= kSeeds; ++s.seed)
    square += std::pow(noise_free_nrmse(sampled(box->solve(s)), r1, r2), 2) / kSeeds;
  const double fixed = std::sqrt(square);
  EXPECT_LE(fixed, 0.01) << "unfiltered";
  RecordProperty("nrmse_percent",
                 std::to_string(100 * adaptive) + ", " + std::to_string(100 * fixed));
  // The references must be good enough for the figure to mean something: the error of the mean of
  // (x - r1)(x - r2), about their variance over the root of the number of values, stays far below
  // (1 %)^2. The difference of the two has twice that variance.
  const double difference = noise_free_nrmse(r1, r2, r2);
  const double variance = difference * difference / 2;
  EXPECT_LT(variance / std::sqrt(3.0 * box->texels().size()), 0.002 * 0.002);
}

TEST(Agreement, GatherMeetsPathUnderSkyAndSun) {
  QuadScene yard(64);
  yard.add({{-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, {0.5f, 0.4f, 0.3f}});
  yard.add_block({-0.5f, 0, -0.5f}, {0.5f, 1, 0.5f}, {0.7f, 0.2f, 0.2f});
  yard.build();
  yard.scene().sky = {0.3f, 0.5f, 1};
  scene::PunctualLight sun;
  sun.type = scene::PunctualType::kDirectional;
  sun.intensity = {4, 4, 3};
  sun.direction = normalize(math::Vec3{1, -1.5f, 0.4f});
  yard.scene().lights = {sun};
  const auto r1 = sampled(path_reference(yard, 256, 3)), r2 = sampled(path_reference(yard, 256, 4));
  const auto gather = yard.solve({});
  EXPECT_LE(noise_free_nrmse(shown(gather), r1, r2), 0.01);
  EXPECT_LE(noise_free_nrmse(sampled(gather), r1, r2), 0.01);
}

/// Methods that exchange light between texels, beside the light of paths. They err where surfaces
/// touch; elsewhere it is the same light.
class TexelsBesidePaths : public testing::TestWithParam<const char*> {
 protected:
  /// Most of the light, and few passes and short paths.
  static constexpr std::uint32_t kBounces = 3;

  /// Bakes a scene on a page of `side`, and knows which texels lie apart from other surfaces.
  struct Bakes {
    Bakes(const char* name, std::uint32_t side) : room(name, 0, side) {
      proto::SolverSettings s;
      s.method = proto::Method::kPath;
      s.samples = side < 128 ? 1024 : 192;
      s.direct_samples = 256;
      s.bounces = side < 128 ? 32 : kBounces;
      s.seed = 11;
      r1 = light(s);
      s.seed = 12;
      r2 = light(s);
      // Many points of a texel find what stands on it, or on its edge, where its middle does not.
      s.pair_samples = 16;
      near = touches(room.world(s), 2);
      share = double(std::ranges::count(near, true)) / double(near.size());
    }
    std::vector<math::Rgb> light(const proto::SolverSettings& s) const {
      const World world = room.world(s);
      const auto solver = baker::make_solver(world);
      exec::ThreadPool pool(2);
      return sampled(test::must(baker::solve(world, *solver, pool, {})));
    }
    std::vector<math::Rgb> apart(const std::vector<math::Rgb>& all) const {
      std::vector<math::Rgb> some;
      for (std::uint32_t t = 0; t < all.size(); ++t)
        if (!near[t]) some.push_back(all[t]);
      return some;
    }
    double error(const proto::SolverSettings& s, const std::string& name) const {
      const auto e = light(s);
      const double apart_only = noise_free_nrmse(apart(e), apart(r1), apart(r2));
      testing::Test::RecordProperty(name + "_percent", std::to_string(100 * apart_only));
      testing::Test::RecordProperty(name + "_all_percent",
                                    std::to_string(100 * noise_free_nrmse(e, r1, r2)));
      return apart_only;
    }

    const test::ReadyScene room;
    std::vector<math::Rgb> r1, r2;
    std::vector<bool> near;
    double share = 0;
  };
};

TEST_P(TexelsBesidePaths, At128) {
  const Bakes bakes(GetParam(), 128);
  RecordProperty("touching_percent", std::to_string(100 * bakes.share));
  EXPECT_LT(bakes.share, 0.35) << "what is left must mean something";
  for (const proto::Method method : {proto::Method::kPairwise, proto::Method::kLinks}) {
    proto::SolverSettings s;
    s.method = method;
    s.bounces = kBounces;
    s.direct_samples = 256;
    s.link_error = 0.0005f;
    EXPECT_LE(bakes.error(s, proto::to_string(method)), 0.01) << proto::to_string(method);
    if (method != proto::Method::kLinks) continue;
    s.link_error = proto::SolverSettings().link_error;
    EXPECT_LE(bakes.error(s, "links_default"), 0.02) << "the default";
  }
}

TEST_P(TexelsBesidePaths, MatrixAt64) {
  const Bakes bakes(GetParam(), 64);
  RecordProperty("touching_percent", std::to_string(100 * bakes.share));
  EXPECT_LT(bakes.share, 0.4) << "what is left must mean something";
  proto::SolverSettings s;
  s.method = proto::Method::kMatrix;
  s.direct_samples = 256;
  EXPECT_LE(bakes.error(s, "matrix1"), 0.02);
  s.pair_samples = 16;
  EXPECT_LE(bakes.error(s, "matrix16"), 0.01);
}

INSTANTIATE_TEST_SUITE_P(Boxes, TexelsBesidePaths, testing::Values("cornell", "cornell_layers"),
                         [](const auto& box) { return std::string(box.param); });

// By RTRad's number of directions the error is below 1 %, and not far above it by the default.
TEST(Agreement, DirectionalMeetsPathOnTheCornellBox) {
  const auto box = cornell(128);
  const auto r1 = sampled(path_reference(*box, 256, 11)),
             r2 = sampled(path_reference(*box, 256, 12));
  proto::SolverSettings s;
  s.method = proto::Method::kDirectional;
  s.direct_samples = 256;
  const auto error = [&](const std::string& name) {
    const double e = noise_free_nrmse(sampled(box->solve(s)), r1, r2);
    RecordProperty(name + "_percent", std::to_string(100 * e));
    return e;
  };
  s.samples = 1024;
  EXPECT_LE(error("1024"), 0.01);
  s.samples = 256;
  EXPECT_LE(error("256"), 0.015);
  s.rotate_directions = false;
  EXPECT_LE(error("256_fixed"), 0.015);
  s.direction_set = proto::DirectionSetKind::kHemicube;
  EXPECT_LE(error("300_hemicube_fixed"), 0.02);
}

// Random sampling falls with N^-1/2. Stratified by nets, a gather falls faster: towards N^-1 where
// the radiosity seen is smooth, N^-3/4 across its edges. Quadrupling N must at least bring 4^0.6.
TEST(Convergence, GatherErrorFallsFasterThanRandom) {
  const auto box = cornell(64);
  proto::SolverSettings s;
  double last = 0;
  s.direct_samples = 64;
  s.coarse_indirect = false;
  for (const std::uint32_t samples : {16u, 64u, 256u}) {
    s.samples = samples;
    const double error = scatter(*box, s, &lightmap::Lightmap::indirect, 16);
    if (last > 0) {
      EXPECT_LT(error, last * std::pow(4, -0.6)) << samples << " samples";
    }
    last = error;
  }
}

// Paths have too many dimensions for nets to help much: N^-1/2, give or take the scatter of the
// figure itself (a few percent with thousands of texels).
TEST(Convergence, PathErrorFallsWithTheSquareRoot) {
  const auto box = cornell(64);
  proto::SolverSettings s;
  s.method = proto::Method::kPath;
  s.bounces = 4;
  s.samples = 16;
  const double few = scatter(*box, s, &lightmap::Lightmap::indirect);
  s.samples = 256;
  const double many = scatter(*box, s, &lightmap::Lightmap::indirect);
  EXPECT_LT(many, few / 4 * 1.15);
}

// However rays are put into packets, the light is the same but for noise, and no thread changes it.
TEST(RayPatterns, AllGiveTheSameLight) {
  const auto box = cornell(64);
  proto::SolverSettings s;
  s.samples = 256;
  s.direct_samples = 64;
  s.coarse_indirect = false;
  const auto mean = [](const Solution& solution) {
    double sum = 0, square = 0;
    for (std::uint32_t t = 0; t < solution.light->size(); ++t) {
      sum += luminance(solution.light->indirect[t]);
      square += std::pow(double(solution.light->indirect_difference[t]), 2);
    }
    return std::pair(sum / solution.light->size(), std::sqrt(square) / solution.light->size());
  };
  s.ray_pattern = proto::RayPattern::kIncoherent;
  const auto [expected, error] = mean(box->solve(s));
  for (const auto& [pattern, name] :
       {std::pair(proto::RayPattern::kTile, "tile"), std::pair(proto::RayPattern::kBlock, "block"),
        std::pair(proto::RayPattern::kStrata, "strata"),
        std::pair(proto::RayPattern::kIncoherent, "incoherent")}) {
    s.ray_pattern = pattern;
    const Solution one = box->solve(s, 1), many = box->solve(s, 3);
    EXPECT_EQ(one.ray_pattern, name);
    EXPECT_TRUE(same_bits(one.light->indirect, many.light->indirect)) << name;
    // Bounces carry errors on, and texels of a tile share some: a few standard errors.
    EXPECT_NEAR(mean(one).first, expected, 10 * error) << name;
    if (pattern == proto::RayPattern::kTile) {
      s.ray_pattern = proto::RayPattern::kAuto;
      EXPECT_EQ(box->solve(s).ray_pattern, "tile") << "few triangles, many texels";
    }
  }
}

TEST(Determinism, ThreadCountChangesNoBit) {
  const auto box = cornell(64);
  for (const baker::Method& method : baker::methods()) {
    proto::SolverSettings s;
    s.method = method.id;
    if (!method.adaptive) s.samples = 32;
    const Solution one = box->solve(s, 1);
    for (const unsigned threads : {2u, 3u, 8u}) {
      const Solution many = box->solve(s, threads);
      EXPECT_TRUE(same_bits(one.light->direct, many.light->direct)) << threads;
      EXPECT_TRUE(same_bits(one.light->indirect, many.light->indirect)) << threads;
      EXPECT_TRUE(same_bits(shown(one), shown(many))) << threads;
    }
    s.seed = 2;
    EXPECT_FALSE(same_bits(one.light->indirect, box->solve(s, 1).light->indirect));
  }
}

// Fewer remembered hits than samples: few feed the bounces, the rest follow, to the same light.
TEST(HitBudget, RoundsAgreeWithTheFullCache) {
  const auto box = cornell(64);
  const auto rays = trace::RayScene::build(box->scene());
  const light::LightSet lights(box->scene());
  const trace::TexelLookup lookup(box->scene(), box->atlas(), box->texels());
  proto::SolverSettings s;
  s.samples = 256;
  s.direct_samples = 64;
  exec::ThreadPool pool(2);
  const World world{box->scene(),
                    box->atlas(),
                    box->texels(),
                    *rays,
                    lights,
                    lookup,
                    s,
                    baker::sample_plan(s, {})};
  const auto tight = gather::make_gather_solver(world, 0);
  const auto solution = baker::solve(world, *tight, pool, {});
  ASSERT_TRUE(solution);
  EXPECT_EQ(solution->passes.back().name, "round");
  for (const std::uint32_t n : solution->light->samples) ASSERT_EQ(n, 256u);
  const auto few = sampled(*solution), all = sampled(box->solve(s));
  EXPECT_LT(noise_free_nrmse(few, all, all), 0.02);
}

TEST(Bounces, MoreBouncesAddLightUpToTheLimitOfTheSeries) {
  const auto box = cornell(32);
  proto::SolverSettings s;
  s.samples = 64;
  double last = 0;
  for (const std::uint32_t bounces : {0u, 1u, 2u, 4u, 16u, 64u}) {
    s.bounces = bounces;
    const Solution solution = box->solve(s);
    double mean = 0;
    for (std::uint32_t t = 0; t < box->texels().size(); ++t)
      mean += solution.light->irradiance(t).g;
    EXPECT_GE(mean, last * (bounces > 16 ? 0.999 : 1.0)) << bounces;
    if (bounces == 0) {
      for (const math::Rgb& e : solution.light->indirect) EXPECT_TRUE(is_black(e));
    }
    last = mean;
  }
}

}  // namespace
}  // namespace kiln::solver
