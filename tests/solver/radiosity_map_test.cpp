// Radiosity maps: the loss of the averaged series as theory has it, and light without loss.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "baker/methods.h"
#include "baker/solver/radiosity_map/ambient_term.h"
#include "baker/solver/radiosity_map/radiosity_map.h"
#include "baker/solver/radiosity_map/series.h"
#include "tests/solver/cornell_box.h"
#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver::radiosity_map {
namespace {

proto::SolverSettings settings_for(proto::Series series, std::uint32_t samples) {
  proto::SolverSettings s;
  s.method = proto::Method::kRadiosityMap;
  s.series = series;
  s.samples = samples;
  s.direct_samples = 64;
  s.light_sampling = proto::LightSampling::kSolidAngle;
  return s;
}

std::vector<Step> iterations(const std::vector<std::uint32_t>& counts) {
  std::vector<Step> steps;
  std::uint32_t done = 0;
  for (const std::uint32_t n : counts) {
    steps.emplace_back().read = {done, n};
    done += n;
  }
  return steps;
}

/// The passes of a small map.
std::vector<Step> steps_of(const proto::SolverSettings& s) {
  return averaged_steps(s, iterated_plan(s, {}, false), 1000);
}

TEST(SeriesShares, AreThoseOfASumByHand) {
  const auto one_by_one = series_shares(iterations({1, 1, 1}), 4);
  EXPECT_EQ(one_by_one[0], 1);
  EXPECT_EQ(one_by_one[1], 1);
  EXPECT_DOUBLE_EQ(one_by_one[2], 2. / 3);
  EXPECT_DOUBLE_EQ(one_by_one[3], 1. / 6);
  EXPECT_EQ(one_by_one[4], 0);
  const auto in_two = series_shares(iterations({1, 2}), 3);
  EXPECT_DOUBLE_EQ(in_two[2], 2. / 3) << "both of the second pass read one reflection";
  EXPECT_EQ(in_two[3], 0) << "and neither reads the other";
}

// Eq. 3.18 as it is written, for passes of one iteration.
TEST(SeriesShares, AreTheRecursionOfTheThesis) {
  std::function<double(int, int)> kappa = [&](int k, int m) -> double {
    if (k == 0) return 1;
    if (m == 0) return 0;
    double sum = 0;
    for (int n = k; n <= m; ++n) sum += kappa(k - 1, n - 1);
    return sum / m;
  };
  for (int m = 1; m <= 9; ++m) {
    const auto share = series_shares(iterations(std::vector<std::uint32_t>(m, 1)), 5);
    for (int k = 0; k <= 5; ++k) EXPECT_NEAR(share[k], kappa(k, m), 1e-12) << k << " of " << m;
  }
}

TEST(AveragedSteps, TakeEverySampleOnce) {
  for (const std::uint32_t limit : {1u, 3u, 16u, 50u, 64u, 100u, 800u, 2000u})
    for (const std::uint32_t direct : {1u, 20u, 200u, 3000u})
      for (const std::uint32_t bounces : {0u, 1u}) {
        proto::SolverSettings s;
        s.samples = limit;
        s.direct_samples = direct;
        s.bounces = bounces;
        std::uint32_t traced = 0, read = 0, lit = 0;
        const auto steps = steps_of(s);
        for (const Step& step : steps) {
          EXPECT_TRUE(step.direct.count == 0 || step.direct.first == lit);
          EXPECT_TRUE(step.trace.count == 0 || step.trace.first == traced);
          EXPECT_TRUE(step.read.count == 0 || step.read.first == read);
          EXPECT_LE(step.read.count, std::max(1u, read / kGrowth));
          lit += step.direct.count, traced += step.trace.count, read += step.read.count;
          EXPECT_LE(read, traced);
          EXPECT_EQ(step.completes, &step == &steps.back());
        }
        EXPECT_EQ(traced, limit);
        EXPECT_EQ(read, bounces > 0 ? limit : 0);
        EXPECT_EQ(lit, direct);
      }
}

TEST(AveragedSteps, OfTheDefaultsAreFewAndLoseLittle) {
  const auto steps = steps_of({});
  EXPECT_EQ(steps.size(), 63u);
  EXPECT_EQ(steps[0].direct.count, 16u) << "the first picture";
  const auto thesis = iterations(std::vector<std::uint32_t>(800, 1));
  for (const double albedo : {0.5, 0.8}) {
    EXPECT_GT(missing_share(steps, albedo), missing_share(thesis, albedo));
    EXPECT_LT(missing_share(steps, albedo), 1.05 * missing_share(thesis, albedo));
  }
}

TEST(KeptDirections, FitTheirMemory) {
  proto::SolverSettings s;
  const SamplePlan plan = iterated_plan(s, {}, false);
  EXPECT_EQ(plan.directions, 800u);
  EXPECT_EQ(plan.shadow_rays, 200u);
  const double mib = double(1u << 20);
  s.hit_memory_mib = 1;
  EXPECT_EQ(kept_directions(s, plan, mib / 4 / 64), 64u);
  EXPECT_EQ(kept_directions(s, plan, mib / 4 / 63), 32u);
  EXPECT_EQ(kept_directions(s, plan, mib), 1u) << "at least the first";
  s.hit_memory_mib = 1024;
  EXPECT_EQ(kept_directions(s, plan, mib), 64u);
  s.bounces = 0;
  EXPECT_EQ(kept_directions(s, plan, mib), 0u);
}

// A room that all its faces light and reflect, where E = M/(1-ρ) [Moreno-Fortuny eq. 2.15].
class LightRoom : public testing::TestWithParam<float> {};
INSTANTIATE_TEST_SUITE_P(, LightRoom, testing::Values(0.5f, 0.8f));

struct RoomOfLight {
  QuadScene room{32};
  double whole;  ///< lx

  explicit RoomOfLight(float albedo) : whole(double(math::kPi) * 0.5 / (1 - double(albedo))) {
    room.add_room({-1, 0, -1}, {1, 2, 1}, {albedo, albedo, albedo}, {0.5f, 0.5f, 0.5f});
    room.build();
  }
  std::vector<std::uint32_t> all() const {
    std::vector<std::uint32_t> t(room.texels().size());
    std::iota(t.begin(), t.end(), 0u);
    return t;
  }
};

constexpr int kSeeds = 8;
constexpr double kSigmas = 8, kRounding = 2e-4;

// The averaged series lacks what eq. 3.18 says of its passes, which falls as M^-(1-ρ).
TEST_P(LightRoom, AveragedSeriesLacksWhatTheorySays) {
  const double albedo = double(GetParam());
  const RoomOfLight light(GetParam());
  double last = 0;
  for (const std::uint32_t samples : {64u, 256u, 1024u}) {
    const proto::SolverSettings s = settings_for(proto::Series::kAveraged, samples);
    const SeedStudy study(light.room, s, kSeeds, light.all());
    const double missing = 1 - study.area_mean / light.whole;
    const double expected = missing_share(steps_of(s), albedo);
    RecordProperty("missing_percent_" + std::to_string(samples),
                   std::to_string(100 * missing) + " of " + std::to_string(100 * expected));
    EXPECT_NEAR(missing, expected, kSigmas * study.area_standard_error / light.whole + kRounding);
    // The power law is that of many iterations: the Γ function in front of it tends to a constant.
    if (last > 0) {
      EXPECT_NEAR(missing / last, std::pow(4, albedo - 1), 0.03) << samples;
    }
    last = missing;
  }
}

// The light of emitters that texels send comes an order later, and so lacks more.
TEST_P(LightRoom, AveragedSeriesOfTransportLacksAnOrderMore) {
  const double albedo = double(GetParam());
  const RoomOfLight light(GetParam());
  proto::SolverSettings s = settings_for(proto::Series::kAveraged, 256);
  s.emitters = proto::Emitters::kTransport;
  const SeedStudy study(light.room, s, kSeeds, light.all());
  const double expected = missing_share(steps_of(s), albedo, 1);
  EXPECT_GT(expected, missing_share(steps_of(s), albedo));
  EXPECT_NEAR(1 - study.area_mean / light.whole, expected,
              kSigmas * study.area_standard_error / light.whole + kRounding);
  s.bounces = 0;
  const SeedStudy straight(light.room, s, kSeeds, light.all());
  EXPECT_NEAR(straight.area_mean, light.whole * (1 - albedo), 1e-3 * light.whole)
      << "what emitters send, and nothing reflected";
}

TEST_P(LightRoom, UnbiasedSeriesLacksNothing) {
  const double albedo = double(GetParam());
  const RoomOfLight light(GetParam());
  proto::SolverSettings s = settings_for(proto::Series::kUnbiased, 64);
  s.bounces = 12;
  s.tolerance = 0;
  const SeedStudy study(light.room, s, kSeeds, light.all());
  const double expected = light.whole * (1 - std::pow(albedo, 13));
  EXPECT_NEAR(study.area_mean, expected,
              kSigmas * study.area_standard_error + kRounding * expected);
  for (std::size_t i = 0; i < study.mean.size(); ++i)
    EXPECT_NEAR(study.mean[i], expected, kSigmas * study.standard_error[i] + 1e-3 * expected);
}

/// Two bakes of one scene that differ in their seed.
struct Pair {
  Solution first, second;

  Pair(const QuadScene& scene, proto::SolverSettings s, std::uint64_t seed)
      : first(scene.solve(with(s, seed))), second(scene.solve(with(s, seed + 1))) {}

 private:
  static proto::SolverSettings with(proto::SolverSettings s, std::uint64_t seed) {
    s.seed = seed;
    return s;
  }
};

Pair paths(const QuadScene& scene, std::uint32_t samples) {
  proto::SolverSettings s;
  s.method = proto::Method::kPath;
  s.samples = samples;
  return {scene, s, 100};
}

/// nRMSE of a method against paths. Two independent bakes of either cancel all noise:
/// mean((x1 - r1)(x2 - r2)) is the square of what they differ by on average.
double systematic_nrmse(const Pair& of, const Pair& path) {
  double square = 0, mean = 0;
  const std::uint32_t n = path.first.light->size();
  for (std::uint32_t t = 0; t < n; ++t) {
    const math::Rgb a = path.first.light->irradiance(t), b = path.second.light->irradiance(t);
    const math::Rgb d = (of.first.light->irradiance(t) - a) * (of.second.light->irradiance(t) - b);
    square += (double(d.r) + d.g + d.b) / 3;
    mean += (double(a.r) + a.g + a.b + b.r + b.g + b.b) / 6;
  }
  return std::sqrt(std::max(0.0, square / n)) / (mean / n);
}

/// The area-weighted mean luminance of both, lx.
double mean_light(const QuadScene& scene, const Pair& of) {
  double sum = 0, area = 0;
  for (std::uint32_t t = 0; t < scene.texels().size(); ++t) {
    const double a = double(scene.texels().area_m2[t]);
    const math::Rgb e = of.first.light->irradiance(t) + of.second.light->irradiance(t);
    sum += a * double(luminance(e)) / 2, area += a;
  }
  return sum / area;
}

TEST(RadiosityMapAgreement, MeetsPathOnTheCornellBox) {
  const auto box = cornell(128);
  const Pair path = paths(*box, 32);
  const Pair unbiased(*box, settings_for(proto::Series::kUnbiased, 32), 5);
  const double error = systematic_nrmse(unbiased, path);
  RecordProperty("nrmse_percent", std::to_string(100 * error));
  EXPECT_LE(error, 0.01);
  // The averaged series lacks about what its warning says: the box is closed, and the share is that
  // of a room with the mean albedo everywhere, so a quarter more or less is what it can promise.
  const proto::SolverSettings averaged = settings_for(proto::Series::kAveraged, 128);
  const double lacking = 1 - mean_light(*box, Pair(*box, averaged, 5)) / mean_light(*box, path);
  double albedo = 0, area = 0;
  for (std::uint32_t t = 0; t < box->texels().size(); ++t) {
    const double a = double(box->texels().area_m2[t]);
    albedo += a * double(luminance(box->texels().albedo[t])), area += a;
  }
  const double told = missing_share(steps_of(averaged), albedo / area);
  RecordProperty("lacking_percent",
                 std::to_string(100 * lacking) + " of " + std::to_string(100 * told));
  EXPECT_NEAR(lacking, told, 0.25 * told);
}

TEST(RadiosityMapAgreement, MeetsPathUnderSkyAndSun) {
  QuadScene yard(48);
  yard.add({{-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, {0.5f, 0.4f, 0.3f}});
  yard.add_block({-0.5f, 0, -0.5f}, {0.5f, 1, 0.5f}, {0.7f, 0.2f, 0.2f});
  yard.build();
  yard.scene().sky = {0.3f, 0.5f, 1};
  scene::PunctualLight sun;
  sun.type = scene::PunctualType::kDirectional;
  sun.intensity = {4, 4, 3};
  sun.direction = normalize(math::Vec3{1, -1.5f, 0.4f});
  yard.scene().lights = {sun};
  const Pair path = paths(yard, 128);
  for (const auto series : {proto::Series::kAveraged, proto::Series::kUnbiased})
    EXPECT_LE(systematic_nrmse({yard, settings_for(series, 128), 5}, path), 0.01) << int(series);
}

// Where a lamp is near, points spread over its area bring fireflies: 1/r² has no bound.
TEST(LightSampling, AllModesGiveTheSameLightAndStratifiedHasTheLeastNoise) {
  const auto box = cornell(64);
  proto::SolverSettings s = settings_for(proto::Series::kAveraged, 1);
  s.bounces = 0;
  s.direct_samples = 64;
  std::vector<std::uint32_t> floor = box->texels_of(2);
  std::vector<SeedStudy> studies;
  std::vector<double> noise;
  for (const auto sampling : {proto::LightSampling::kUniform, proto::LightSampling::kStratified,
                              proto::LightSampling::kSolidAngle}) {
    s.light_sampling = sampling;
    studies.emplace_back(*box, s, kSeeds, floor);
    double square = 0;
    for (const double e : studies.back().standard_error) square += e * e;
    noise.push_back(std::sqrt(square / double(floor.size())) / studies.back().area_mean);
  }
  RecordProperty("noise_percent", std::to_string(100 * noise[0]) + ", " +
                                      std::to_string(100 * noise[1]) + ", " +
                                      std::to_string(100 * noise[2]));
  for (const SeedStudy& study : studies)
    EXPECT_NEAR(study.area_mean, studies[0].area_mean,
                kSigmas * std::hypot(study.area_standard_error, studies[0].area_standard_error));
  EXPECT_LT(noise[1], 0.85 * noise[0]);
}

/// The standard error that bakes tell, over the scatter between their seeds: root mean squares.
double told_over_true(const QuadScene& scene, proto::SolverSettings s) {
  constexpr int kBakes = 8;
  const std::uint32_t n = scene.texels().size();
  std::vector<double> sum(n), square(n);
  double told = 0;
  for (int i = 0; i < kBakes; ++i) {
    s.seed = 40 + std::uint64_t(i);
    const Solution solution = scene.solve(s);
    const lightmap::Lightmap& light = *solution.light;
    for (std::uint32_t t = 0; t < n; ++t) {
      const double e = double(luminance(light.irradiance(t)));
      sum[t] += e / kBakes, square[t] += e * e / kBakes;
      const double direct = double(light.direct_difference[t]);
      const double gathered =
          double(light.sky_difference[t]) + double(light.indirect_difference[t]);
      told += (direct * direct + gathered * gathered) / kBakes;
    }
  }
  double scatter = 0;
  for (std::uint32_t t = 0; t < n; ++t)
    scatter += std::max(0.0, square[t] - sum[t] * sum[t]) * kBakes / (kBakes - 1);
  return std::sqrt(told / scatter);
}

TEST(RadiosityMapError, IsToldAsItIs) {
  const auto box = cornell(48);
  for (const auto series : {proto::Series::kAveraged, proto::Series::kUnbiased})
    for (const auto sampling : {proto::LightSampling::kUniform, proto::LightSampling::kStratified})
      for (const bool random : {false, true}) {
        proto::SolverSettings s = settings_for(series, 128);
        s.bounces = 4;
        s.light_sampling = sampling;
        if (random) s.without = {proto::Technique::kLowDiscrepancy};
        const double ratio = told_over_true(*box, s);
        const std::string name =
            std::to_string(int(series)) + std::to_string(int(sampling)) + std::to_string(random);
        RecordProperty("ratio_" + name, std::to_string(ratio));
        // Halves of the points of a net differ as independent points do: that tells too much.
        EXPECT_GT(ratio, 0.85) << name;
        EXPECT_LT(ratio, sampling == proto::LightSampling::kStratified ? 3.0 : 1.35) << name;
      }
}

TEST(RadiosityMapError, EndsTheIterationsAtATarget) {
  const auto box = cornell(64);
  proto::SolverSettings s = settings_for(proto::Series::kAveraged, 4096);
  s.direct_samples = 4096;
  const Solution solution = box->solve(s, 2, {.target_error = 0.05f});
  const auto& last = solution.passes.back();
  ASSERT_TRUE(last.standard_error.has_value());
  EXPECT_LE(*last.standard_error, 0.05);
  EXPECT_LT(solution.light->samples[0], 4096u);
  for (std::size_t i = 0; i + 1 < solution.passes.size(); ++i)
    EXPECT_GT(solution.passes[i].standard_error.value_or(1), 0.05) << "no pass too many";
}

// With the same directions everywhere the error is a pattern: neighbors on a flat wall err alike.
TEST(SameDirections, GiveAPatternInPlaceOfNoise) {
  const auto box = cornell(128);
  const auto wall = box->texels_of(0);
  // What two seeds differ by is error alone.
  const auto difference_of_neighbors = [&](bool same) {
    proto::SolverSettings s = settings_for(proto::Series::kAveraged, 16);
    s.same_directions = same;
    const Pair pair(*box, s, 7);
    const auto error = [&](std::uint32_t t) {
      return double(pair.first.light->indirect[t].r) - double(pair.second.light->indirect[t].r);
    };
    double rough = 0, all = 0;
    for (const std::uint32_t t : wall) {
      const std::int32_t n = box->texels().neighbor(t, 1, 0);
      if (n == atlas::kNoTexel) continue;
      rough += std::pow(error(t) - error(std::uint32_t(n)), 2), all += 2 * std::pow(error(t), 2);
    }
    return rough / all;
  };
  const double same = difference_of_neighbors(true), own = difference_of_neighbors(false);
  RecordProperty("neighbors", std::to_string(same) + ", " + std::to_string(own));
  EXPECT_LT(same, 0.5);
  EXPECT_GT(own, 0.7);
}

// Direct light and the term are all light there is, where every texel sees the same.
TEST_P(LightRoom, AmbientTermStandsForTheBouncesToCome) {
  const RoomOfLight light(GetParam());
  proto::SolverSettings s = settings_for(proto::Series::kAveraged, 16);
  s.bounces = 0;
  s.direct_samples = 256;
  const Solution solution = light.room.solve(s);
  const auto guessed = with_ambient_term(light.room.texels(), *solution.light);
  double mean = 0;
  for (const std::uint32_t t : light.all())
    mean += double(guessed.irradiance(t).g) / double(guessed.size());
  EXPECT_NEAR(mean, light.whole, 0.02 * light.whole);
  EXPECT_EQ(guessed.indirect[0].g, guessed.indirect[guessed.size() - 1].g);
  EXPECT_TRUE(is_black(solution.light->indirect[0])) << "the light itself has none";
}

TEST_P(LightRoom, AmbientTermCountsWhatEmittersSend) {
  const RoomOfLight light(GetParam());
  const lightmap::Lightmap dark(light.room.texels().size());
  const float sent = math::kPi * 0.5f;
  const std::vector<math::Rgb> emittance(dark.size(), math::Rgb{sent, sent, sent});
  const auto guessed = with_ambient_term(light.room.texels(), dark, emittance);
  EXPECT_NEAR(double(guessed.irradiance(0).g), light.whole, 1e-3 * light.whole);
}

TEST(RadiosityMapRemarks, TellWhatTheSeriesLacks) {
  const auto box = cornell(32);
  const auto rays = test::must(trace::RayScene::build(box->scene()));
  const light::LightSet lights(box->scene());
  const trace::TexelLookup lookup(box->scene(), box->atlas(), box->texels());
  proto::SolverSettings s = settings_for(proto::Series::kAveraged, 800);
  s.direct_samples = 200;
  const auto remarks = [&] {
    const World world{box->scene(),
                      box->atlas(),
                      box->texels(),
                      rays,
                      lights,
                      lookup,
                      s,
                      baker::sample_plan(s, {})};
    return make_radiosity_map_solver(world)->remarks(std::vector<proto::PassReport>(63), {});
  };
  const auto told = remarks();
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0].code, "series_short_of_light");
  EXPECT_NE(told[0].message.find("misses 0.12 %, 1.1 %, 4.4 %"), std::string::npos)
      << told[0].message;
  s.bounces = 0;
  EXPECT_TRUE(remarks().empty());
  s.bounces = 16;
  s.series = proto::Series::kUnbiased;
  EXPECT_TRUE(remarks().empty());
}

}  // namespace
}  // namespace kiln::solver::radiosity_map
