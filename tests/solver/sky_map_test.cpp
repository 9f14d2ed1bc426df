// Light from a sky that a map gives: closed forms, the two ways of finding it against each other,
// and gather against path.
#include <gtest/gtest.h>

#include <functional>

#include "baker/light/sky_light.h"
#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"
#include "tests/solver/every_method.h"
#include "tests/support/quad_scene.h"

namespace kiln::solver {
namespace {

using Radiance = std::function<float(math::Vec3)>;

/// What a pixel of a map that is not turned shows at its middle.
math::Vec3 direction_of(std::uint32_t x, std::uint32_t y, std::uint32_t rows) {
  const float theta = math::kPi * (float(y) + 0.5f) / float(rows);
  const float phi = 2 * math::kPi * ((float(x) + 0.5f) / float(2 * rows) - 0.5f);
  return {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)};
}

scene::SkyMap gray_map(std::uint32_t rows, const Radiance& radiance) {
  scene::SkyMap map;
  map.width = 2 * rows;
  map.height = rows;
  for (std::uint32_t y = 0; y < rows; ++y)
    for (std::uint32_t x = 0; x < map.width; ++x) {
      const float l = radiance(direction_of(x, y, rows));
      map.texels.push_back({l, l, l});
    }
  return map;
}

scene::Scene sky_scene(std::uint32_t rows, const Radiance& radiance) {
  scene::Scene scene;
  scene.sky_map = gray_map(rows, radiance);
  return scene;
}

/// Sum over the map's pixels of radiance, solid angle and what `of` gives.
double integral(const scene::SkyMap& map, const std::function<double(math::Vec3)>& of) {
  double sum = 0;
  for (std::uint32_t y = 0; y < map.height; ++y) {
    const double sr = (std::cos(double(math::kPi) * y / map.height) -
                       std::cos(double(math::kPi) * (y + 1) / map.height)) *
                      2 * double(math::kPi) / map.width;
    for (std::uint32_t x = 0; x < map.width; ++x)
      sum += double(map.texels[std::size_t(y) * map.width + x].g) * sr *
             of(direction_of(x, y, map.height));
  }
  return sum * double(map.scale);
}

const math::Vec3 kSun = normalize(math::Vec3{0.5f, 0.7f, 0.3f});

/// A sky of 1 with a sun of so much, 2 degrees wide, over dark ground.
Radiance sunny(float sun, math::Vec3 at = kSun) {
  return [=](math::Vec3 d) {
    return dot(d, at) > std::cos(math::kPi / 180) ? sun : d.y > 0 ? 1.f : 0.1f;
  };
}

proto::SolverSettings samples(std::uint32_t n, proto::Method method = proto::Method::kGather) {
  proto::SolverSettings s;
  s.method = method;
  s.samples = s.direct_samples = n;
  s.bounces = 4;
  return s;
}

TEST(SkyLight, LooksWhereTheSettingsSay) {
  scene::Scene scene = sky_scene(64, [](math::Vec3) { return 0.f; });
  scene::SkyMap& map = scene.sky_map;
  const auto pixel = [&](std::uint32_t x, std::uint32_t y) -> math::Rgb& {
    return map.texels[std::size_t(y) * map.width + x];
  };
  pixel(64, 32) = {1, 0, 0};  // the center
  pixel(96, 32) = {0, 1, 0};  // half way to its right edge
  pixel(64, 8) = {0, 0, 1};   // above the center
  map.scale = 2;
  const auto seen = [&](math::Vec3 d) {
    return light::SkyLight(scene).seen(normalize(d)).radiance;
  };
  EXPECT_EQ(seen({1, -0.02f, 0.02f}), (math::Rgb{2, 0, 0}));
  EXPECT_EQ(seen({-0.02f, -0.02f, 1}), (math::Rgb{0, 2, 0}));
  EXPECT_EQ(seen({0.43f, 1, 0.01f}), (math::Rgb{0, 0, 2}));
  EXPECT_EQ(seen({-1, 0, 0}), math::Rgb{});
  map.rotation = math::kPi / 2;
  EXPECT_EQ(seen({0.02f, -0.02f, -1}), (math::Rgb{2, 0, 0})) << "the center is seen along -Z";
  EXPECT_EQ(seen({1, -0.02f, 0.02f}), (math::Rgb{0, 2, 0}));
  scene.sky = {1, 1, 1};
  EXPECT_EQ(seen({1, -0.02f, 0.02f}), (math::Rgb{1, 3, 1}));
}

TEST(SkyLight, DrawsFromTheDensityThatItTells) {
  for (const float rotation : {0.f, 2.5f}) {
    scene::Scene scene = sky_scene(32, [](math::Vec3 d) {
      return d.y > 0.95f ? 30.f : d.x > 0.8f ? 5 + d.z : d.y < -0.99f ? 40.f : 0.5f;
    });
    scene.sky_map.rotation = rotation;
    const light::SkyLight sky(scene);
    ASSERT_TRUE(sky.has_bright_parts());
    // Of a function of the direction: the mean over samples of f / density is its integral over
    // where the density is positive.
    const auto f = [](math::Vec3 d) { return 1 + 0.5 * d.x + 0.3 * d.y * d.z + d.z * d.z; };
    const int n = 1 << 16;
    double drawn = 0, exact = 0;
    for (int i = 0; i < n; ++i) {
      const auto s = sky.sample(scrambled(sampling::sobol(std::uint32_t(i)), 7));
      ASSERT_GT(s.seen.density, 0);
      ASSERT_NEAR(length(s.direction), 1, 1e-5);
      drawn += f(s.direction) / double(s.seen.density) / n;
    }
    const int side = 2048;
    double total = 0;
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x) {
        const float up = 1 - 2 * (float(y) + 0.5f) / side, flat = std::sqrt(1 - up * up);
        const float phi = 2 * math::kPi * (float(x) + 0.5f) / side;
        const math::Vec3 d{flat * std::cos(phi), up, flat * std::sin(phi)};
        const double sr = 4 * double(math::kPi) / side / side,
                     density = double(sky.seen(d).density);
        total += density * sr;
        exact += density > 0 ? f(d) * sr : 0;
      }
    EXPECT_NEAR(total, 1, 1e-3);
    EXPECT_NEAR(drawn, exact, 2e-3 * exact);
  }
}

TEST(SkyLight, ADirectionThatIsDrawnSeesItsPixel) {
  const scene::Scene scene =
      sky_scene(64, [](math::Vec3 d) { return d.x + d.y > 0.3f ? 2 + d.z : 0.1f; });
  const light::SkyLight sky(scene);
  int others = 0;
  constexpr int kDraws = 10'000;
  for (std::uint32_t i = 0; i < kDraws; ++i) {
    const auto s = sky.sample(scrambled(sampling::sobol(i), 3));
    others += !(sky.seen(s.direction).radiance == s.seen.radiance);
  }
  EXPECT_LT(others, kDraws / 500) << "all but those on the edge of two pixels";
}

// The error of the light on an open plane, by as many directions in all.
TEST(SkyLight, BothWaysTogetherAreFarBetterThanTheHemisphereAlone) {
  const scene::Scene scene = sky_scene(128, sunny(1e4f));
  const light::SkyLight sky(scene);
  const sampling::Frame up({0, 1, 0});
  const double exact = integral(scene.sky_map, [](math::Vec3 d) { return std::max(0.f, d.y); });
  const light::SkyShares shares(1, 1);
  constexpr std::uint32_t kEach = 32, kSeeds = 400;
  double both_square = 0, alone_square = 0, mean = 0;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    const auto cosine_sample = [&](std::uint32_t i) {
      return up.to_world(
          sampling::cosine_direction(scrambled(sampling::sobol(i), sampling::hash(seed, 1))));
    };
    double both = 0, alone = 0;
    for (std::uint32_t i = 0; i < 2 * kEach; ++i)
      alone += double(math::kPi * sky.seen(cosine_sample(i)).radiance.g) / (2 * kEach);
    for (std::uint32_t i = 0; i < kEach; ++i) {
      const math::Vec3 d = cosine_sample(i);
      const auto seen = sky.seen(d);
      both += double(math::kPi * seen.radiance.g * shares.of_cosine(seen.density, d.y)) / kEach;
      const auto s = sky.sample(scrambled(sampling::sobol(i), sampling::hash(seed, 2)));
      const float cosine = std::max(0.f, s.direction.y);
      both += double(s.seen.radiance.g * cosine * shares.of_bright(s.seen.density, cosine)) / kEach;
    }
    both_square += std::pow(both - exact, 2), alone_square += std::pow(alone - exact, 2);
    mean += both / kSeeds;
  }
  const double both_error = std::sqrt(both_square / kSeeds),
               alone_error = std::sqrt(alone_square / kSeeds);
  EXPECT_NEAR(mean, exact, 4 * both_error / std::sqrt(double(kSeeds)) + 1e-4 * exact);
  EXPECT_LT(both_error, alone_error / 1000);
  RecordProperty("percent", std::to_string(100 * both_error / exact) + ", " +
                                std::to_string(100 * alone_error / exact));
}

TEST(SkyLight, WorkersMakeTheSameTable) {
  const scene::Scene scene = sky_scene(61, [](math::Vec3 d) { return sunny(500)(d) + d.x * d.x; });
  const light::SkyLight alone(scene);
  for (const unsigned threads : {1u, 3u}) {
    exec::ThreadPool pool(threads);
    const exec::Workers workers{pool, {}};
    const light::SkyLight sky(scene, &workers);
    for (std::uint32_t i = 0; i < 4096; ++i) {
      const math::Vec2 u = scrambled(sampling::sobol(i), 5);
      const auto a = alone.sample(u), b = sky.sample(u);
      ASSERT_EQ(a.direction, b.direction);
      ASSERT_EQ(a.seen.density, b.seen.density);
      ASSERT_EQ(a.seen.radiance, b.seen.radiance);
    }
  }
}

TEST(SkyLight, AStopEndsTheTable) {
  const scene::Scene scene = sky_scene(32, sunny(500));
  exec::ThreadPool pool(2);
  std::stop_source stop;
  const exec::Workers workers{pool, stop.get_token()};
  EXPECT_TRUE(light::SkyLight(scene, &workers).has_bright_parts());
  stop.request_stop();
  EXPECT_FALSE(light::SkyLight(scene, &workers).has_bright_parts()) << "all of it was made";
}

TEST(SkyLight, WhereNothingStandsOutNoDirectionsAreDrawn) {
  EXPECT_FALSE(light::SkyLight(sky_scene(32, [](math::Vec3) { return 0.7f; })).has_bright_parts());
  EXPECT_TRUE(
      light::SkyLight(sky_scene(32, [](math::Vec3 d) { return 1 + d.y; })).has_bright_parts());
  scene::Scene drowned = sky_scene(32, [](math::Vec3 d) { return 1 + d.y; });
  drowned.sky = {1e4f, 1e4f, 1e4f};
  EXPECT_FALSE(light::SkyLight(drowned).has_bright_parts());
}

class SkyByEveryMethod : public testing::TestWithParam<proto::Method> {};

/// A floor of 4 m with a block on it, and a wall at its back.
QuadScene yard(std::uint32_t page_size) {
  QuadScene scene(page_size);
  scene.add({{-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, {0.5f, 0.4f, 0.3f}});
  scene.add({{-2, 0, -2}, {4, 0, 0}, {0, 2, 0}, {0.6f, 0.6f, 0.6f}});
  scene.add_block({-0.5f, 0, -0.5f}, {0.5f, 1, 0.5f}, {0.7f, 0.2f, 0.2f});
  scene.build();
  return scene;
}

TEST_P(SkyByEveryMethod, AMapOfOneValueIsAUniformSky) {
  QuadScene scene = yard(32);
  scene.scene().sky = {3, 3, 3};
  const Solution uniform = scene.solve(samples(64, GetParam()));
  scene.scene().sky = {1, 1, 1};
  scene.scene().sky_map = gray_map(16, [](math::Vec3) { return 0.5f; });
  scene.scene().sky_map.scale = 4;
  const Solution map = scene.solve(samples(64, GetParam()));
  for (std::uint32_t t = 0; t < scene.texels().size(); ++t) {
    const float e = uniform.light->irradiance(t).g;
    EXPECT_NEAR(map.light->irradiance(t).g, e, 1e-4f * e);
    EXPECT_NEAR(map.light->sky_difference[t], uniform.light->sky_difference[t], 1e-4f * e);
  }
}

TEST_P(SkyByEveryMethod, ASunBringsItsSolidAngleTimesTheCosine) {
  for (const float rotation : {0.f, 1.f}) {
    QuadScene scene(16);
    const auto floor = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
    const auto wall = scene.add({{5, 0, 0}, {0, 1, 0}, {0, 0, 1}});  // faces +X
    scene.build();
    scene::SkyMap& map = scene.scene().sky_map;
    map = gray_map(256, sunny(1e4f));
    for (math::Rgb& c : map.texels)
      if (c.g < 2) c = {};
    map.rotation = rotation;
    map.scale = 0.25f;
    const Solution solution = scene.solve(samples(64, GetParam()));
    // Few of the directions by cosine meet the sun; each of them adds about 1.5 %, and only gather
    // has those of several texels fill the gaps between each other.
    const double scatter = GetParam() == proto::Method::kGather ? 0.01 : 0.05;
    const auto expect = [&](std::uint32_t quad, const std::function<double(math::Vec3)>& cosine) {
      const double e = integral(map, cosine);
      double mean = 0;
      const auto texels = scene.texels_of(quad);
      for (const std::uint32_t t : texels) {
        EXPECT_NEAR(solution.light->irradiance(t).g, e, scatter * e);
        mean += double(solution.light->irradiance(t).g) / double(texels.size());
      }
      EXPECT_NEAR(mean, e, scatter / 5 * e);
    };
    expect(floor, [](math::Vec3 d) { return d.y; });
    // The way to the sun turns with the map.
    const float c = std::cos(rotation), s = std::sin(rotation);
    expect(wall, [=](math::Vec3 d) { return c * d.x + s * d.z; });
  }
}

TEST_P(SkyByEveryMethod, ASkyThatVariesSlowly) {
  QuadScene scene(16);
  const auto up = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  const auto down = scene.add({{-1, -1, -1}, {2, 0, 0}, {0, 0, 2}});
  scene.build();
  scene.scene().sky_map = gray_map(128, [](math::Vec3 d) { return 1 + d.y; });
  const Solution solution = scene.solve(samples(256, GetParam()));
  const auto mean = [&](std::uint32_t quad) {
    double sum = 0;
    for (const std::uint32_t t : scene.texels_of(quad))
      sum += double(solution.light->irradiance(t).g) / double(scene.texels_of(quad).size());
    return sum;
  };
  // The integral of (1 + cosθ) cosθ over the hemisphere is π + 2π/3; below, π - 2π/3.
  EXPECT_NEAR(mean(up), 5 * math::kPi / 3, 2e-3 * 5 * math::kPi / 3);
  EXPECT_NEAR(mean(down), math::kPi / 3, 4e-3 * math::kPi / 3);
}

TEST_P(SkyByEveryMethod, TheSunCastsAShadow) {
  QuadScene scene(64);
  const auto floor = scene.add({{-2, 0, -2}, {0, 0, 4}, {4, 0, 0}});
  scene.add({{-3, 1, -2}, {6, 0, 0}, {0, 0, 2}});  // a roof over the half at -Z, seen from below
  scene.build();
  const math::Vec3 sun{0, std::cos(0.2f), std::sin(0.2f)};  // in front of it
  scene.scene().sky_map = gray_map(256, sunny(1e4f, sun));
  for (math::Rgb& c : scene.scene().sky_map.texels)
    if (c.g < 2) c = {};
  const Solution solution = scene.solve(samples(64, GetParam()));
  const double open =
      integral(scene.scene().sky_map, [](math::Vec3 d) { return std::max(0.f, d.y); });
  const double edge = -std::tan(0.2);  // of the shadow, in z; the penumbra is 0.05 m wide
  int lit = 0, dark = 0;
  for (const std::uint32_t t : scene.texels_of(floor)) {
    const double z = scene.texels().position[t].z, e = solution.light->irradiance(t).g;
    if (z > edge + 0.2) {
      EXPECT_NEAR(e, open, 0.05 * open);
      ++lit;
    } else if (z < edge - 0.2) {
      EXPECT_EQ(e, 0);
      ++dark;
    }
  }
  EXPECT_GT(lit, 100);
  EXPECT_GT(dark, 100);
}

INSTANTIATE_TEST_SUITE_P(, SkyByEveryMethod, testing::ValuesIn(all_methods()), method_name);

/// See Agreement.*
double nrmse(const QuadScene& scene, const std::function<math::Rgb(std::uint32_t)>& x,
             const Solution& a, const Solution& b) {
  double square = 0, mean = 0;
  for (std::uint32_t t = 0; t < scene.texels().size(); ++t) {
    const double e = luminance(x(t)), p = luminance(a.light->irradiance(t)),
                 q = luminance(b.light->irradiance(t));
    square += (e - p) * (e - q);
    mean += (p + q) / 2;
  }
  const double n = scene.texels().size();
  return std::sqrt(std::max(0., square / n)) / (mean / n);
}

TEST(SkyMapAgreement, GatherMeetsPathUnderASun) {
  QuadScene scene = yard(64);
  scene::SkyMap& map = scene.scene().sky_map;
  map = gray_map(256, sunny(1e4f));
  for (math::Rgb& c : map.texels)
    c = c.g > 2 ? math::Rgb{c.g, 0.9f * c.g, 0.7f * c.g} : c * math::Rgb{0.4f, 0.7f, 1};
  map.rotation = 0.7f;
  auto paths = samples(256, proto::Method::kPath);
  paths.bounces = 16;
  paths.seed = 3;
  const Solution r1 = scene.solve(paths);
  paths.seed = 4;
  const Solution r2 = scene.solve(paths);
  const Solution gather = scene.solve({});
  const double shown = nrmse(
      scene, [&](std::uint32_t t) { return gather.irradiance(t); }, r1, r2);
  const double sampled = nrmse(
      scene, [&](std::uint32_t t) { return gather.light->irradiance(t); }, r1, r2);
  EXPECT_LE(shown, 0.012);
  EXPECT_LE(sampled, 0.012);
  RecordProperty("nrmse_percent",
                 std::to_string(100 * shown) + ", " + std::to_string(100 * sampled));
}

TEST(SkyMapAgreement, TheSpreadIsTheErrorBetweenSeeds) {
  QuadScene scene = yard(32);
  scene.scene().sky_map = gray_map(128, sunny(1e4f));
  auto s = samples(64);
  s.bounces = 0;
  s.coarse_indirect = false;
  constexpr int kSeeds = 24;
  const std::uint32_t n = scene.texels().size();
  std::vector<double> sum(n), square(n);
  double told = 0, scatter = 0;
  for (int i = 0; i < kSeeds; ++i) {
    s.seed = 100 + std::uint64_t(i);
    const Solution solution = scene.solve(s);
    for (std::uint32_t t = 0; t < n; ++t) {
      const double e = luminance(solution.light->irradiance(t));
      sum[t] += e, square[t] += e * e;
      told += (std::pow(double(solution.light->direct_difference[t]), 2) +
               std::pow(double(solution.light->sky_difference[t]), 2)) /
              kSeeds;
    }
  }
  for (std::uint32_t t = 0; t < n; ++t)
    scatter += (square[t] - sum[t] * sum[t] / kSeeds) / (kSeeds - 1);
  const double ratio = std::sqrt(told / scatter);
  EXPECT_GT(ratio, 0.8);
  EXPECT_LT(ratio, 2.0);
  RecordProperty("told_over_true", std::to_string(ratio));
}

TEST(SkyMapAgreement, SameBitsOnAnyNumberOfThreads) {
  QuadScene scene = yard(64);
  scene.scene().sky_map = gray_map(64, sunny(1e4f));
  for (const baker::Method& method : baker::methods()) {
    proto::SolverSettings s;
    s.method = method.id;
    if (!method.adaptive) s.samples = 32;
    proto::QualitySettings quality;
    quality.preset = proto::Preset::kPreview;
    const Solution one = scene.solve(s, 1, quality), three = scene.solve(s, 3, quality);
    EXPECT_TRUE(same_bits(one.light->direct, three.light->direct));
    EXPECT_TRUE(same_bits(one.light->sky, three.light->sky));
    EXPECT_TRUE(same_bits(one.light->indirect, three.light->indirect));
    EXPECT_TRUE(same_bits(one.filtered.sky, three.filtered.sky));
  }
}

// What a texel gets does not depend on how its rays were put into packets, in the mean.
TEST(SkyMapAgreement, EveryRayPatternSeesTheSameSky) {
  QuadScene scene = yard(32);
  scene.scene().sky_map = gray_map(64, sunny(100));
  double first = 0;
  for (const auto pattern : {proto::RayPattern::kTile, proto::RayPattern::kBlock,
                             proto::RayPattern::kStrata, proto::RayPattern::kIncoherent}) {
    auto s = samples(256);
    s.ray_pattern = pattern;
    // Texels of a tile share the cells of their directions: a few seeds for a figure that stays.
    constexpr int kSeeds = 8;
    double sky = 0;
    for (s.seed = 1; s.seed <= kSeeds; ++s.seed) {
      const Solution solution = scene.solve(s);
      for (const math::Rgb c : solution.light->sky) sky += double(luminance(c)) / kSeeds;
    }
    if (first == 0) first = sky;
    EXPECT_NEAR(sky, first, 2e-3 * first);
  }
}

}  // namespace
}  // namespace kiln::solver
