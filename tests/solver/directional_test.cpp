// A fixed set of directions for every texel: the light that it leads to, and its error.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "baker/methods.h"
#include "baker/solver/directional/radiosity_mips.h"
#include "baker/solver/directional/ring_order.h"
#include "baker/solver/directional/tile_rays.h"
#include "tests/solver/cornell_box.h"
#include "tests/support/quad_scene.h"

namespace kiln::solver::directional {
namespace {

proto::SolverSettings settings_for(std::uint32_t samples) {
  proto::SolverSettings s;
  s.method = proto::Method::kDirectional;
  s.samples = samples;
  s.direct_samples = 64;
  return s;
}

/// A scene with all that rays need.
struct ReadyWorld {
  trace::RayScene rays;
  light::LightSet lights;
  trace::TexelLookup lookup;
  World world;

  ReadyWorld(const QuadScene& s, const proto::SolverSettings& settings)
      : rays(trace::RayScene::build(s.scene()).value()),
        lights(s.scene()),
        lookup(s.scene(), s.atlas(), s.texels()),
        world{s.scene(), s.atlas(), s.texels(), rays,
              lights,    lookup,    settings,   baker::sample_plan(settings, {})} {}
};

double mean_indirect(const Solution& s) {
  double sum = 0;
  for (std::uint32_t t = 0; t < s.light->size(); ++t)
    sum += double(luminance(s.light->indirect[t]));
  return sum / s.light->size();
}

/// Root mean square of the difference of two lights, over the mean of the second.
double difference(const Solution& a, const Solution& b) {
  double square = 0;
  for (std::uint32_t t = 0; t < a.light->size(); ++t)
    square += std::pow(double(luminance(a.light->indirect[t] - b.light->indirect[t])), 2);
  return std::sqrt(square / a.light->size()) / mean_indirect(b);
}

// B = M/(1-ρ) in a room whose faces all emit M and reflect ρ [Moreno-Fortuny eq. 2.15], and so the
// bounces bring ρ/(1-ρ) of the direct light. Weights sum to 1, and no direction lies in the
// surface: all that errs is the direct light that is read.
TEST(DirectionalFurnace, RadiosityIsEmittanceOverAbsorptance) {
  for (const float albedo : {0.5f, 0.8f})
    for (const auto set :
         {proto::DirectionSetKind::kLargestEmptyCircle, proto::DirectionSetKind::kHemicube}) {
      QuadScene room(32);
      room.add_room({-1, 0, -1}, {1, 2, 1}, {albedo, albedo, albedo}, {0.5f, 0.5f, 0.5f});
      room.build();
      proto::SolverSettings s = settings_for(256);
      s.direction_set = set;
      s.bounces = 64;
      s.tolerance = 0;
      const Solution solution = room.solve(s);
      const auto mean = [&](const lightmap::Plane<math::Rgb>& light) {
        double sum = 0;
        for (std::uint32_t t = 0; t < light.size(); ++t) sum += double(light[t].g) / light.size();
        return sum;
      };
      const double direct = mean(solution.light->direct);
      EXPECT_NEAR(direct, math::kPi * 0.5, 5e-3 * direct);
      const double expected = direct * double(albedo) / (1 - double(albedo));
      EXPECT_NEAR(mean(solution.light->indirect), expected, 2e-3 * expected);
      for (std::uint32_t t = 0; t < room.texels().size(); ++t)
        EXPECT_NEAR(solution.light->indirect[t].g, expected, 0.01 * expected) << t;
    }
}

// All directions are there whatever they are turned by, and they are about those of the others.
TEST(DirectionalOrder, TurnedTexelsSendAboutTheSameDirectionAtATime) {
  const RingOrder order(sampling::disc_directions(256, 1, sampling::DiscRule::kCells));
  std::uint32_t all = 0;
  for (const RingOrder::Ring& ring : order.rings) {
    EXPECT_EQ(ring.begin, all);
    all += ring.size;
    for (const float turn : {0.f, 0.1f, 0.37f, 0.5f, 0.9999f}) {
      const std::uint32_t start = RingOrder::start_of(ring, turn);
      ASSERT_LT(start, ring.size);
      const float c = std::cos(2 * math::kPi * turn), s = std::sin(2 * math::kPi * turn);
      for (std::uint32_t k = 0; k < ring.size; ++k) {
        const std::uint32_t d = ring.begin + (start + k) % ring.size, plain = ring.begin + k;
        const math::Vec3 turned{c * order.set.x[d] - s * order.set.y[d],
                                s * order.set.x[d] + c * order.set.y[d], order.set.z[d]};
        EXPECT_GT(dot(turned, {order.set.x[plain], order.set.y[plain], order.set.z[plain]}), 0.6f)
            << turn;
      }
    }
  }
  EXPECT_EQ(all, 256u);
  EXPECT_GT(order.rings.size(), 5u);
}

TEST(DirectionalLight, AgreesTurnedOrNot) {
  const auto box = cornell(64);
  proto::SolverSettings s = settings_for(1024);
  const Solution turned = box->solve(s);
  s.rotate_directions = false;
  const Solution fixed = box->solve(s);
  RecordProperty("fixed_against_turned_percent", std::to_string(100 * difference(fixed, turned)));
  EXPECT_NEAR(mean_indirect(fixed) / mean_indirect(turned), 1, 0.005);
  EXPECT_GT(difference(fixed, turned), 1e-4);
  EXPECT_LT(difference(fixed, turned), 0.03);
  s.direction_set = proto::DirectionSetKind::kHemicube;
  const Solution cube = box->solve(s);
  EXPECT_EQ(cube.light->samples[0], 972u);
  EXPECT_NEAR(mean_indirect(cube) / mean_indirect(turned), 1, 0.01);
}

// A texel's light does not depend on those that share its packets.
TEST(DirectionalLight, IsThatOfATexelAlone) {
  const auto box = cornell(64);
  const ReadyWorld ready(*box, settings_for(64));
  const World& world = ready.world;
  const RingOrder order(sampling::disc_directions(64, 1, sampling::DiscRule::kCells));
  lightmap::Lightmap light(world.texels.size());
  for (std::uint32_t t = 0; t < light.size(); ++t) light.direct[t] = {1, float(t), 2};
  exec::ThreadPool pool(2);
  RadiosityMips radiosity;
  ASSERT_TRUE(radiosity.read(world, light, {}, {pool, {}}));
  const TileRays rays(world, order, radiosity);
  const auto all = rays.follow(32, 16);
  for (std::uint32_t i = 0; i < 16; ++i) {
    const auto alone = rays.follow(32 + i, 1);
    EXPECT_EQ(alone[0].light.mean, all[i].light.mean);
    EXPECT_EQ(alone[0].light.half_difference, all[i].light.half_difference);
    EXPECT_GT(all[i].light.mean.g, 0);
  }
}

// The told standard error is the scatter between seeds, within a quarter.
TEST(DirectionalLight, TellsItsError) {
  const auto box = cornell(64);
  for (const std::uint32_t samples : {64u, 256u, 1024u}) {
    proto::SolverSettings s = settings_for(samples);
    s.bounces = 3;
    const double real = scatter(*box, s, &lightmap::Lightmap::indirect, 2);
    const Solution solution = box->solve(s);
    double told = 0;
    for (std::uint32_t t = 0; t < solution.light->size(); ++t)
      told += std::pow(double(solution.light->indirect_difference[t]), 2);
    told = std::sqrt(told / solution.light->size()) / mean_indirect(solution);
    RecordProperty("told_over_real_" + std::to_string(samples), std::to_string(told / real));
    EXPECT_NEAR(told / real, 1, 0.25) << samples;
  }
}

// As printed, a direction counts by cosθ/(π r²): the nearer, the more, without bound but for the
// cut. On this box a bounce returns more light than it was sent, and bounces have no end.
TEST(DirectionalCompat, IsFarOff) {
  const auto box = cornell(64);
  proto::SolverSettings s = settings_for(256);
  s.tolerance = 0;
  for (const std::uint32_t bounces : {1u, 2u, 8u, 16u}) {
    s.bounces = bounces;
    s.rtrad_compat = false;
    const Solution right = box->solve(s);
    s.rtrad_compat = true;
    const Solution wrong = box->solve(s);
    const double ratio = mean_indirect(wrong) / mean_indirect(right);
    RecordProperty("light_over_right_" + std::to_string(bounces), std::to_string(ratio));
    RecordProperty("off_percent_" + std::to_string(bounces),
                   std::to_string(100 * difference(wrong, right)));
    EXPECT_GT(difference(wrong, right), 0.5) << bounces;
    if (bounces == 1) {
      EXPECT_LT(ratio, 0.7) << "too little of what is far";
    } else if (bounces == 16) {
      EXPECT_GT(ratio, 10) << "too much of what is near";
    }
  }
}

TEST(DirectionalBounces, EndAtTheToleranceOrAtTheLimit) {
  const auto box = cornell(32);
  proto::SolverSettings s = settings_for(64);
  s.bounces = 64;
  const Solution solution = box->solve(s);
  ASSERT_GT(solution.passes.size(), 4u);
  ASSERT_LT(solution.passes.size(), 30u);
  EXPECT_EQ(solution.passes.back().rays, std::uint64_t(64) * box->texels().size());
  s.bounces = 2;
  EXPECT_EQ(box->solve(s).passes.size(), 3u);
  s.bounces = 0;
  const Solution direct = box->solve(s);
  EXPECT_EQ(direct.passes.size(), 1u);
  EXPECT_TRUE(is_black(direct.light->indirect[0]));
}

/// A light whose radiosity is the green channel of what is given for each texel.
struct Mips {
  QuadScene scene;
  RadiosityMips mips;

  explicit Mips(std::uint32_t page) : scene(page) {
    scene.add({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {1, 1, 1}});
    scene.add({{0, 1, 0}, {1, 0, 0}, {0, 0, 1}, {1, 1, 1}});
    scene.build();
  }
  void read(const std::function<float(std::uint32_t)>& value,
            const std::function<float(std::uint32_t)>& validity) {
    const ReadyWorld ready(scene, {});
    lightmap::Lightmap light(scene.texels().size());
    for (std::uint32_t t = 0; t < light.size(); ++t) {
      const float e = value(t);
      light.direct[t] = {e, e, e};
      light.validity[t] = validity(t);
    }
    exec::ThreadPool pool(2);
    ASSERT_TRUE(mips.read(ready.world, light, {}, {pool, {}}));
  }
  float albedo(std::uint32_t t) const { return scene.texels().albedo[t].g; }
};

TEST(RadiosityMips, MeansAreOfOneChartAndOfWhatCanBeSeen) {
  Mips m(32);
  const atlas::TextureGroup& t = m.scene.texels();
  const auto first = m.scene.texels_of(0), second = m.scene.texels_of(1);
  // One chart is bright, the other dark.
  m.read([&](std::uint32_t i) { return t.chart[i] == t.chart[first[0]] ? 4.f : 0.f; },
         [](std::uint32_t) { return 1.f; });
  for (const float spread : {0.f, 0.01f, 0.1f, 1.f, 100.f}) {
    for (const std::uint32_t i : first) EXPECT_NEAR(m.mips.at(i, spread).g, 4 * m.albedo(i), 1e-5);
    for (const std::uint32_t i : second) EXPECT_EQ(m.mips.at(i, spread).g, 0);
  }
  // The coarsest mean is that of the chart by area, each texel by what of it can be seen.
  const auto value = [&](std::uint32_t i) { return float(t.x[i]); };
  const auto validity = [&](std::uint32_t i) { return t.y[i] % 2 ? 0.5f : 1.f; };
  m.read(value, validity);
  double sum = 0, area = 0;
  for (const std::uint32_t i : first) {
    sum +=
        double(t.area_m2[i]) * double(value(i)) * double(m.albedo(i));  // E / validity · validity
    area += double(t.area_m2[i]) * double(validity(i));
  }
  EXPECT_NEAR(m.mips.at(first[3], 1e6f).g, sum / area, 1e-4 * sum / area);
  // A spread below four texels reads one.
  const float texel = t.area_m2[first[40]] / t.coverage[first[40]];
  EXPECT_NEAR(m.mips.at(first[40], 3.9f * texel).g,
              value(first[40]) / validity(first[40]) * m.albedo(first[40]), 1e-4);
  // From four on, the square of two by two around it.
  double square = 0, weight = 0;
  for (const std::uint32_t i : first)
    if (t.x[i] / 2 == t.x[first[40]] / 2 && t.y[i] / 2 == t.y[first[40]] / 2) {
      square += double(t.area_m2[i]) * double(value(i)) * double(m.albedo(i));
      weight += double(t.area_m2[i]) * double(validity(i));
    }
  EXPECT_NEAR(m.mips.at(first[40], 4.1f * texel).g, square / weight, 1e-4 * square / weight);
}

TEST(RadiosityMips, HiddenTexelsReadThoseAroundThem) {
  Mips m(32);
  const auto first = m.scene.texels_of(0);
  const std::uint32_t hidden = first[20];
  m.read([&](std::uint32_t t) { return t == hidden ? 0.f : 3.f; },
         [&](std::uint32_t t) { return t == hidden ? 0.05f : 1.f; });
  EXPECT_NEAR(m.mips.at(hidden, 0).g, 3 * m.albedo(hidden), 1e-5);
  m.read([](std::uint32_t) { return 3.f; }, [](std::uint32_t) { return 0.f; });
  EXPECT_EQ(m.mips.at(hidden, 0).g, 0) << "nothing of the chart can be seen";
}

}  // namespace
}  // namespace kiln::solver::directional
