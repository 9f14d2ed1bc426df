// Choosing among many lights: the weights, the intervals, and the light that comes of it.
#include "baker/light/light_table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"
#include "tests/support/quad_scene.h"

namespace kiln::light {
namespace {

math::Vec3 vector_of(std::uint32_t i, std::uint32_t seed) {
  const math::Vec2 a = scrambled(sampling::sobol(i), seed),
                   b = scrambled(sampling::sobol(i), sampling::hash(seed));
  return {2 * a.x - 1, 2 * a.y - 1, 2 * b.x - 1};
}

AreaLight triangle(math::Vec3 corner, math::Vec3 first_edge, math::Vec3 second_edge,
                   math::Rgb radiance) {
  AreaLight light;
  light.corner = {corner, corner + first_edge, corner + second_edge, {}};
  const math::Vec3 c = cross(first_edge, second_edge);
  light.normal = normalize(c);
  light.area_m2 = length(c) / 2;
  light.longest_edge_m =
      std::max({length(first_edge), length(second_edge), length(first_edge - second_edge)});
  light.radiance = radiance;
  return light;
}

/// Small lights in all places around the origin, turned all ways; some shine to both sides.
std::vector<AreaLight> swarm(std::uint32_t count) {
  std::vector<AreaLight> lights;
  for (std::uint32_t i = 0; i < count; ++i) {
    const math::Vec3 u = normalize(vector_of(i, 2)), v = normalize(cross(u, vector_of(i, 3)));
    lights.push_back(
        triangle(vector_of(i, 1) * 3, u * 0.1f, v * 0.1f, {float(i % 7 + 1), 1, 0.5f}));
    lights.back().two_sided = i % 5 == 0;
  }
  return lights;
}

std::vector<float> shares_of(const std::vector<AreaLight>& lights) {
  double total = 0;
  for (const AreaLight& l : lights) total += luminance(l.radiance) * l.area_m2;
  std::vector<float> shares;
  for (const AreaLight& l : lights)
    shares.push_back(float(luminance(l.radiance) * l.area_m2 / total));
  return shares;
}

struct Weighed {
  std::vector<float> weight;
  std::vector<std::uint32_t> near;

  Weighed(const LightTable& table, simd::InstructionSet set, math::Vec3 p, math::Vec3 n,
          float reach, float extent = 0)
      : weight(table.groups() * 16), near(table.groups()) {
    kernels(set).weigh_lights(table.data(), table.groups(),
                              {{p.x, p.y, p.z}, {n.x, n.y, n.z}, extent, reach}, weight.data(),
                              near.data());
  }
};

/// Irradiance of a surface at the origin from a triangle that is wholly above its horizon, by the
/// midpoint rule.
double irradiance_at_origin(const AreaLight& light, math::Vec3 n) {
  constexpr int kSteps = 24;
  double sum = 0;
  int points = 0;
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; i + j < kSteps; ++j, ++points) {
      const float u = (float(i) + 1 / 3.f) / kSteps, v = (float(j) + 1 / 3.f) / kSteps;
      const math::Vec3 d = light.corner[0] + light.first_edge() * u + light.second_edge() * v;
      const double r2 = double(dot(d, d));
      sum += double(dot(d, n)) * std::abs(double(dot(d, light.normal))) / (r2 * r2);
    }
  return double(luminance(light.radiance) * light.area_m2) * sum / points;
}

// A light counts as a point: that errs by the square of size over distance. One behind a horizon,
// its own or the surface's, brings nothing.
TEST(LightTable, WeightsAreUnoccludedIrradiance) {
  const std::vector<AreaLight> lights = swarm(1000);
  const LightTable table(lights, shares_of(lights));
  const math::Vec3 n = normalize(math::Vec3{0.2f, 1, -0.3f});
  const Weighed w(table, simd::best_instruction_set(), {}, n, 0.1f);
  int compared = 0, dark = 0;
  for (std::uint32_t place = 0; place < lights.size(); ++place) {
    const AreaLight& light = lights[table.light()[place]];
    const float up = dot(light.center(), n), size = light.longest_edge_m,
                distance = length(light.center());
    if (w.near[place / 16] >> place % 16 & 1) {
      EXPECT_LT(distance, 0.1f + 2 * size);
      EXPECT_EQ(w.weight[place], 0);
    } else if (!light.shows_to(light.height_over({})) || up < -size) {
      ++dark;
      EXPECT_EQ(w.weight[place], 0);
    } else if (up > size) {
      ++compared;
      const double facing =
          double(luminance(light.radiance) * light.area_m2 / dot(light.center(), light.center()));
      EXPECT_NEAR(w.weight[place], irradiance_at_origin(light, n),
                  facing * double(size * size / (distance * distance)));
    }
  }
  EXPECT_GT(compared, 200);
  EXPECT_GT(dark, 500);
}

// Of a wall half of which is above the lamp's plane and half below, the middle sees nothing, the
// lower half a little.
TEST(LightTable, ALightIsWeighedForAllOfTheSurfaceAroundTheViewpoint) {
  const float side = 0.1f, extent = 0.2f, away = 2;
  const std::vector<AreaLight> lights{
      triangle({away, 0, 0}, {side, 0, 0}, {0, 0, side}, {10, 10, 10})};  // shines down
  const LightTable table(lights, shares_of(lights));
  const auto weight_at = [&](float y, float around) {
    return Weighed(table, simd::best_instruction_set(), {0, y, 0}, {1, 0, 0}, 0, around).weight[0];
  };
  ASSERT_EQ(weight_at(0, 0), 0);
  double mean = 0;
  constexpr int kSteps = 200;
  for (int i = 0; i < kSteps; ++i)
    mean += weight_at(extent * (2 * (float(i) + 0.5f) / kSteps - 1), 0) / kSteps;
  EXPECT_NEAR(weight_at(0, extent), mean, 0.02 * mean);
  EXPECT_EQ(weight_at(extent * 1.01f, extent), 0);
  EXPECT_EQ(weight_at(-extent * 1.01f, extent), weight_at(-extent * 1.01f, 0));
}

TEST(LightTable, WeightsHaveTheSameBitsInEveryInstructionSet) {
  const std::vector<AreaLight> lights = swarm(500);
  const LightTable table(lights, shares_of(lights));
  for (std::uint32_t i = 0; i < 16; ++i) {
    const math::Vec3 p = vector_of(i, 9) * 3, n = normalize(vector_of(i, 10));
    const Weighed plain(table, simd::InstructionSet::kSse2, p, n, 0.3f, 0.05f);
    for (const auto set : {simd::InstructionSet::kAvx2, simd::InstructionSet::kAvx512}) {
      if (set > simd::best_instruction_set()) continue;
      const Weighed w(table, set, p, n, 0.3f, 0.05f);
      EXPECT_EQ(std::memcmp(w.weight.data(), plain.weight.data(), 4 * plain.weight.size()), 0);
      EXPECT_EQ(w.near, plain.near);
    }
  }
}

TEST(LightTable, EachLightHasItsPlace) {
  const std::vector<AreaLight> lights = swarm(333);
  const LightTable table(lights, shares_of(lights));
  std::vector<std::uint32_t> found(table.light().begin(), table.light().begin() + 333);
  std::sort(found.begin(), found.end());
  for (std::uint32_t l = 0; l < 333; ++l) EXPECT_EQ(found[l], l);
  EXPECT_EQ(table.groups(), 21u);
}

/// Share of `draws` evenly spaced positions that picks each light.
std::vector<double> picked_shares(const LightChoice& choice, std::size_t lights,
                                  std::uint32_t draws) {
  std::vector<double> shares(lights);
  LightChoice::Walk walk(choice);
  for (std::uint32_t k = 0; k < draws; ++k)
    shares.at(walk.at((k + 0.5) / draws).light) += 1.0 / draws;
  return shares;
}

// A light is picked as often as the probability that comes with it says, and every one is.
TEST(LightChoice, PicksEachLightByItsProbability) {
  constexpr std::uint32_t kDraws = 1 << 20;
  const std::vector<AreaLight> lights = swarm(100);
  const LightTable table(lights, shares_of(lights));
  LightChoice choice(table);
  const auto near = [](std::uint32_t) { return 0.01f; };
  choice.add({{0, 0, 0}, {0, 1, 0}, 0, 0.5f}, near);
  choice.add({{0.1f, 0, 0}, {0, 1, 0}, 0, 0.5f}, near);
  choice.finish();
  const std::vector<double> shares = picked_shares(choice, lights.size(), kDraws);
  std::vector<float> probability(lights.size());
  LightChoice::Walk walk(choice);
  for (std::uint32_t k = 0; k < kDraws; ++k) {
    const auto pick = walk.at((k + 0.5) / kDraws);
    probability[pick.light] = pick.probability;
  }
  double sum = 0;
  for (std::size_t l = 0; l < lights.size(); ++l) {
    EXPECT_GT(probability[l], 0);
    EXPECT_NEAR(shares[l], probability[l], 1.0 / kDraws + 1e-7);  // an interval's ends
    sum += double(probability[l]);
  }
  EXPECT_NEAR(sum, 1, 1e-5);
}

TEST(LightChoice, GoesByPowerWhereNothingShows) {
  std::vector<AreaLight> lights = swarm(40);
  for (AreaLight& l : lights) l.two_sided = true;
  const std::vector<float> power = shares_of(lights);
  const LightTable table(lights, power);
  LightChoice choice(table);
  choice.add({{0, 100, 0}, {0, 1, 0}, 0, 0.1f}, [](std::uint32_t) { return 0.f; });
  choice.finish();
  const auto shares = picked_shares(choice, lights.size(), 1 << 16);
  for (std::size_t l = 0; l < lights.size(); ++l) EXPECT_NEAR(shares[l], power[l], 0x1p-15);
}

TEST(LightChoice, PositionsPastTheEndPickTheLastPlace) {
  const std::vector<AreaLight> lights = swarm(17);
  const LightTable table(lights, shares_of(lights));
  LightChoice choice(table);
  choice.finish();
  LightChoice::Walk walk(choice);
  EXPECT_GT(walk.at(1 - 0x1p-53).probability, -1);  // wherever rounding leaves the last end
  EXPECT_GE(walk.at(1).probability, 0);
}

// Eighty lamps over a floor and close beside it, against Lambert's formula. Nothing is in the way.
TEST(ManyLights, AddUpToLambertsFormula) {
  solver::QuadScene scene(64);
  const auto floor = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  scene.build();
  auto& lamps = scene.scene().rect_lights;
  for (std::uint32_t i = 0; i < 80; ++i) {
    const math::Vec3 at = vector_of(i, 21);
    const float height = i % 8 == 0 ? 0.02f : 0.6f + 0.4f * at.y, level = float(1 + i % 9);
    lamps.push_back(
        {{at.x, height, at.z}, {0.05f, 0.03f * at.y, 0}, {0, 0, 0.04f}, {level, level, level}});
  }
  proto::SolverSettings settings;
  settings.bounces = 0;
  settings.direct_samples = 64;
  const auto texels = scene.texels_of(floor);
  const solver::SeedStudy study(scene, settings, 16, texels);
  const atlas::TextureGroup& group = scene.texels();
  double sum = 0, area = 0;
  for (const std::uint32_t t : texels) {
    double e = 0;
    for (const atlas::SamplePoint& s : group.points_of(t)) {
      const math::Vec3 p = position_at(scene.scene(), s.triangle, s.bary());
      for (const scene::RectLight& l : lamps) {
        const math::Vec3 n = normalize(cross(l.edge_u, l.edge_v));
        if (dot(n, p - l.corner) <= 0) continue;
        const math::Vec3 outline[4] = {l.corner, l.corner + l.edge_u,
                                       l.corner + l.edge_u + l.edge_v, l.corner + l.edge_v};
        e += double(l.radiance.g * sampling::polygon_irradiance(p, {0, 1, 0}, outline));
      }
    }
    sum += e / atlas::TextureGroup::kPointsPerTexel * double(group.area_m2[t]);
    area += double(group.area_m2[t]);
  }
  EXPECT_GT(study.area_standard_error, 0);
  EXPECT_LT(study.area_standard_error, 0.002 * study.area_mean);
  EXPECT_NEAR(study.area_mean, sum / area, 6 * study.area_standard_error);  // 15 degrees of freedom
}

}  // namespace
}  // namespace kiln::light
