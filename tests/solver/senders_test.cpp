// The senders of radiosity over pairs of texels: windows, means and the leaves of a quadtree.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <set>

#include "baker/lightmap/texel_patch.h"
#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pairwise/quadtree.h"
#include "tests/solver/cornell_box.h"
#include "tests/solver/touching.h"
#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver::pairwise {
namespace {

using proto::SenderSeed;
using proto::Undersampling;

proto::SolverSettings plain_settings() {
  proto::SolverSettings s;
  s.method = proto::Method::kPairwise;
  s.direct_samples = 64;
  s.window = 1;
  s.visibility = proto::VisibilityKind::kRay;  // rays are counted
  return s;
}
proto::SolverSettings windows_of(Undersampling kind, std::uint32_t window,
                                 SenderSeed seed = SenderSeed::kWindow) {
  proto::SolverSettings s = plain_settings();
  s.undersampling = kind;
  s.window = window;
  s.sender_seed = seed;
  return s;
}
proto::SolverSettings tree_of(float threshold, std::uint32_t max_node = 8) {
  proto::SolverSettings s = plain_settings();
  s.subdivision_threshold = threshold;
  s.subdivision_max_node = max_node;
  return s;
}
/// One of each strategy.
std::vector<proto::SolverSettings> strategies(std::uint32_t window) {
  return {windows_of(Undersampling::kStride, window),
          windows_of(Undersampling::kMonteCarlo, window),
          windows_of(Undersampling::kMonteCarlo, window, SenderSeed::kReceiver),
          windows_of(Undersampling::kMipmap, window), tree_of(0.1f)};
}

/// Charts that share windows, among them one with a back.
std::unique_ptr<QuadScene> crowded(std::uint32_t page) {
  auto scene = std::make_unique<QuadScene>(page, 0.3f);
  scene->add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
  scene->add_block({-0.5f, 0.2f, -0.3f}, {0.1f, 0.9f, 0.2f}, {0.2f, 0.6f, 0.5f}, true);
  Quad leaf{{0.4f, 0.5f, -0.4f}, {0, 1, 0}, {0.3f, 0, 0.3f}, {0.5f, 0.5f, 0.5f}};
  leaf.double_sided = true;
  scene->add(leaf);
  scene->build();
  scene::PunctualLight lamp;
  lamp.position = {0.5f, 1.5f, 0.3f};
  lamp.intensity = {100, 100, 100};
  scene->scene().lights = {lamp};
  return scene;
}

struct Ready {
  const QuadScene& scene;
  trace::RayScene rays;
  light::LightSet lights;
  trace::TexelLookup lookup;
  World world;
  Parts parts;

  Ready(const QuadScene& s, const proto::SolverSettings& settings)
      : scene(s),
        rays(test::must(trace::RayScene::build(s.scene()))),
        lights(s.scene()),
        lookup(s.scene(), s.atlas(), s.texels()),
        world{s.scene(), s.atlas(), s.texels(), rays,
              lights,    lookup,    settings,   baker::sample_plan(settings, {})},
        parts(world) {}

  std::vector<math::Rgb> radiosity(const lightmap::Lightmap& light) const {
    std::vector<math::Rgb> b(light.size());
    for (std::uint32_t t = 0; t < light.size(); ++t)
      b[t] = parts.reflectance(t) * (light.direct[t] + light.sky[t]);
    return b;
  }
  Senders senders(std::span<const math::Rgb> radiosity, std::uint32_t receiver = 0) const {
    if (!parts.senders.are_per_receiver()) return *parts.senders.pick(radiosity, 0, {});
    Senders own, piece;
    std::uint32_t window = 0;
    do {
      window = parts.senders.pick_for(receiver, radiosity, 0, window, piece);
      own.list.insert(own.list.end(), piece.list.begin(), piece.list.end());
    } while (window > 0);
    return own;
  }
};

double sum_of_areas(const Senders& senders) {
  double sum = 0;
  for (const Sender& s : senders.list) sum += double(s.area_m2);
  return sum;
}

TEST(Windows, HoldEveryTexelOnce) {
  const auto scene = crowded(48);
  const atlas::TextureGroup& t = scene->texels();
  for (const std::uint32_t side : {2u, 3u, 7u, 16u, 100u}) {
    const Windows windows(t, side);
    std::vector<int> seen(t.size());
    std::set<std::uint32_t> places;
    std::uint32_t last_first = 0;
    for (std::uint32_t w = 0; w < windows.size(); ++w) {
      const auto texels = windows.texels(w);
      ASSERT_FALSE(texels.empty());
      EXPECT_TRUE(std::ranges::is_sorted(texels));
      EXPECT_GE(texels.front(), last_first);
      last_first = texels.front();
      EXPECT_TRUE(places.insert(windows.place(w)).second);
      double area = 0;
      for (const std::uint32_t i : texels) {
        ++seen[i];
        area += double(t.area_m2[i]);
        EXPECT_EQ(t.x[i] / side, t.x[texels.front()] / side);
        EXPECT_EQ(t.y[i] / side, t.y[texels.front()] / side);
        EXPECT_EQ(t.is_back(i), t.is_back(texels.front()));
      }
      EXPECT_NEAR(windows.area_m2(w), area, 1e-6 * area);
    }
    EXPECT_TRUE(std::ranges::all_of(seen, [](int n) { return n == 1; }));
  }
}

// Each texel of a window is drawn as often as its share of the area says.
TEST(Windows, TexelsAreDrawnByTheirArea) {
  const auto scene = crowded(48);
  const atlas::TextureGroup& t = scene->texels();
  const Windows windows(t, 4);
  constexpr std::uint32_t kDraws = 4096;
  for (std::uint32_t w = 0; w < windows.size(); ++w) {
    std::vector<double> drawn(t.size());
    for (std::uint32_t i = 0; i < kDraws; ++i)
      drawn[windows.texel_at(w, (float(i) + 0.5f) / kDraws)] += 1.0 / kDraws;
    for (const std::uint32_t i : windows.texels(w))
      EXPECT_NEAR(drawn[i], double(t.area_m2[i]) / double(windows.area_m2(w)), 1.5 / kDraws);
  }
}

// No light is lost or won by the choice of senders.
TEST(Senders, AreasSumToTheSurface) {
  const auto scene = crowded(48);
  const std::vector<math::Rgb> unit(scene->texels().size(), {1, 1, 1});
  double surface = 0;
  for (const float a : scene->texels().area_m2) surface += double(a);
  for (const std::uint32_t window : {1u, 2u, 3u, 4u, 8u, 32u})
    for (const proto::SolverSettings& s : strategies(window)) {
      const Ready ready(*scene, s);
      EXPECT_NEAR(sum_of_areas(ready.senders(unit, 5)), surface, 1e-5 * surface)
          << window << " " << int(s.undersampling);
    }
}

// A sender stands for texels of its own window, and a mean for those of one chart and side. All
// have the light of their texels.
TEST(Senders, MeansAreThoseOfOneChart) {
  const auto scene = crowded(48);
  const atlas::TextureGroup& t = scene->texels();
  const proto::SolverSettings s = windows_of(Undersampling::kMipmap, 8);
  const Ready ready(*scene, s);
  // Each chart and side has light of its own.
  std::vector<math::Rgb> light(t.size());
  for (std::uint32_t i = 0; i < t.size(); ++i)
    light[i] = {float(t.chart[i] + 1), t.is_back(i) ? 2.f : 1.f, 1};
  const Senders senders = ready.senders(light);
  std::set<std::tuple<int, int, std::uint32_t, bool>> cells;
  for (std::uint32_t i = 0; i < t.size(); ++i)
    cells.insert({t.x[i] / 8, t.y[i] / 8, t.chart[i], t.is_back(i)});
  EXPECT_EQ(senders.list.size(), cells.size());
  EXPECT_LT(Windows(t, 8).size(), cells.size()) << "some windows hold two charts";
  for (const Sender& one : senders.list) {
    EXPECT_NEAR(one.radiosity.r, light[one.texel].r, 1e-5f * one.radiosity.r);
    EXPECT_NEAR(one.radiosity.g, light[one.texel].g, 1e-5f);
    if (one.point == Sender::kTexelsOwn) continue;
    const Point& mean = senders.points[one.point];
    const Point texel = ready.parts.patches.middle(one.texel);
    EXPECT_GT(dot(mean.geometric_normal, texel.geometric_normal), 0.9999f) << "flat charts";
    EXPECT_NEAR(dot(mean.position - texel.position, texel.geometric_normal), 0, 1e-5f);
  }
}

// A surface that bends within a window does not hide its own mean.
TEST(Senders, AMeanLiesAboveABentSurface) {
  const test::ReadyScene ball("bumpy_ball", 12, 64);
  const proto::SolverSettings s = windows_of(Undersampling::kMipmap, 8);
  const World world = ball.world(s);
  const Parts parts(world);
  const std::vector<math::Rgb> unit(ball.texels.size(), {1, 1, 1});
  const Senders senders = *parts.senders.pick(unit, 0, {});
  const Windows windows(ball.texels, 8);
  std::uint32_t raised = 0;
  for (const Sender& one : senders.list) {
    if (one.point == Sender::kTexelsOwn) continue;
    const Point& mean = senders.points[one.point];
    EXPECT_NEAR(length(mean.geometric_normal), 1, 1e-5f);
    raised += dot(mean.origin - mean.position, mean.geometric_normal) > 1e-3f;
    for (std::uint32_t t = 0; t < ball.texels.size(); ++t) {
      if (ball.texels.chart[t] != ball.texels.chart[one.texel] ||
          ball.texels.x[t] / 8 != ball.texels.x[one.texel] / 8 ||
          ball.texels.y[t] / 8 != ball.texels.y[one.texel] / 8 ||
          ball.texels.page[t] != ball.texels.page[one.texel] ||
          ball.texels.is_back(t) != ball.texels.is_back(one.texel))
        continue;
      EXPECT_GE(dot(mean.origin - parts.patches.middle(t).position, mean.geometric_normal), -1e-4f);
    }
  }
  EXPECT_GT(raised, 0u);
}

TEST(Senders, StrideTakesTheUpperLeftTexel) {
  const auto scene = crowded(48);
  const atlas::TextureGroup& t = scene->texels();
  const Ready ready(*scene, windows_of(Undersampling::kStride, 3));
  const std::vector<math::Rgb> unit(t.size(), {1, 1, 1});
  for (const Sender& one : ready.senders(unit).list)
    for (std::uint32_t i = 0; i < t.size(); ++i) {
      if (t.chart[i] != t.chart[one.texel] || t.is_back(i) != t.is_back(one.texel)) continue;
      if (t.x[i] / 3 != t.x[one.texel] / 3 || t.y[i] / 3 != t.y[one.texel] / 3) continue;
      EXPECT_GE(std::pair(t.y[i], t.x[i]), std::pair(t.y[one.texel], t.x[one.texel]));
    }
}

// One draw for all receivers, or one for each; anew in every bounce.
TEST(Senders, DrawsHangOnWhatTheSettingsSay) {
  const auto scene = crowded(48);
  const std::vector<math::Rgb> unit(scene->texels().size(), {1, 1, 1});
  const auto texels = [](const Senders& senders) {
    std::vector<std::uint32_t> all;
    for (const Sender& s : senders.list) all.push_back(s.texel);
    return all;
  };
  proto::SolverSettings s = windows_of(Undersampling::kMonteCarlo, 4);
  const Ready shared(*scene, s);
  const auto first = texels(*shared.parts.senders.pick(unit, 0, {}));
  EXPECT_EQ(texels(*shared.parts.senders.pick(unit, 0, {})), first);
  EXPECT_NE(texels(*shared.parts.senders.pick(unit, 1, {})), first);
  s.seed = 2;
  EXPECT_NE(texels(Ready(*scene, s).senders(unit)), first);
  s.sender_seed = SenderSeed::kReceiver;
  const Ready own(*scene, s);
  EXPECT_EQ(texels(own.senders(unit, 3)), texels(own.senders(unit, 3)));
  EXPECT_NE(texels(own.senders(unit, 3)), texels(own.senders(unit, 4)));
}

// A window of a single texel changes no bit, and neither does a quadtree that merges nothing.
TEST(Senders, OfSingleTexelsAreTheTexels) {
  const auto scene = crowded(48);
  for (const std::uint32_t samples : {1u, 4u}) {
    proto::SolverSettings plain = plain_settings();
    plain.pair_samples = samples;
    plain.bounces = 3;
    const Solution expected = scene->solve(plain);
    auto all = strategies(1);
    all.back() = tree_of(0);
    for (proto::SolverSettings& s : all) {
      s.pair_samples = samples;
      s.bounces = 3;
      const Solution solution = scene->solve(s);
      EXPECT_TRUE(same_bits(solution.light->indirect, expected.light->indirect))
          << int(s.undersampling);
      EXPECT_EQ(solution.passes.back().rays, expected.passes.back().rays);
    }
  }
}

// A window of one texel would leave out nothing.
TEST(Windows, HaveTwoTexelsOrMoreWhereNoneIsNamed) {
  proto::SolverSettings s = plain_settings();
  s.window.reset();
  EXPECT_EQ(window_texels(s, 64), 1u);
  EXPECT_EQ(window_texels(s, 512), 4u);
  s.undersampling = Undersampling::kMipmap;
  EXPECT_EQ(window_texels(s, 64), 2u);
  EXPECT_EQ(window_texels(s, 512), 4u);
  s.window = 1;
  EXPECT_EQ(window_texels(s, 64), 1u) << "it is as the settings say";
}

// The reported rays are those of the pairs of a receiver and a sender that face each other.
TEST(Senders, RaysAreThoseOfFacingPairs) {
  const auto scene = crowded(48);
  const atlas::TextureGroup& t = scene->texels();
  auto all = strategies(4);
  all.push_back(plain_settings());
  for (proto::SolverSettings& s : all) {
    s.bounces = 1;
    const Solution solution = scene->solve(s);
    const Ready ready(*scene, s);
    const auto light = ready.radiosity(*solution.light);
    std::uint64_t sure = 0, unsure = 0;
    std::size_t senders = 0;
    for (std::uint32_t i = 0; i < t.size(); ++i) {
      const Senders from = ready.senders(light, i);
      senders = std::max(senders, from.list.size());
      for (const Sender& one : from.list) {
        if (one.texel == i || ready.parts.patches.are_excluded(i, one.texel)) continue;
        const Point at = ready.parts.patches.middle(i);
        const Point to = one.point == Sender::kTexelsOwn ? ready.parts.patches.middle(one.texel)
                                                         : from.points[one.point];
        const math::Vec3d way = to_double(to.position) - to_double(at.position);
        const double least = std::min(dot(way, to_double(at.shading_normal)),
                                      -dot(way, to_double(to.geometric_normal)));
        sure += least > 1e-6, unsure += std::abs(least) <= 1e-6;
      }
    }
    EXPECT_GE(solution.passes.back().rays, sure) << int(s.undersampling);
    EXPECT_LE(solution.passes.back().rays, sure + unsure);
    EXPECT_LE(solution.passes.back().rays, std::uint64_t(senders) * t.size());
    if (s.undersampling == Undersampling::kStride ||
        s.undersampling == Undersampling::kMonteCarlo) {
      EXPECT_LE(senders, Windows(t, 4).size());
    }
  }
}

double nrmse(const Solution& a, const Solution& reference, const std::vector<bool>& without = {}) {
  double square = 0, mean = 0, n = 0;
  for (std::uint32_t t = 0; t < a.light->size(); ++t) {
    if (!without.empty() && without[t]) continue;
    n += 3;
    const math::Rgb e = reference.light->irradiance(t), d = a.light->irradiance(t) - e;
    square += double(d.r) * d.r + double(d.g) * d.g + double(d.b) * d.b;
    mean += double(e.r) + e.g + e.b;
  }
  return std::sqrt(square / n) / (mean / n);
}

// The mean of many draws is the light of all texels. The surfaces are apart: where they touch, the
// limit of view factors takes from some draws.
TEST(MonteCarlo, HasNoBias) {
  QuadScene scene(40);
  scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, {0.6f, 0.5f, 0.4f}});
  scene.add({{-1, 2, -1}, {2, 0, 0}, {0, 0, 2}, {0.3f, 0.8f, 0.5f}});
  scene.add_block({-0.4f, 0.7f, -0.3f}, {0.2f, 1.2f, 0.4f}, {0.7f, 0.7f, 0.7f}, true);
  scene.build();
  scene::PunctualLight lamp;
  lamp.position = {0.7f, 1.5f, 0.1f};
  lamp.intensity = {100, 100, 100};
  scene.scene().lights = {lamp};
  std::vector<std::uint32_t> all(scene.texels().size());
  for (std::uint32_t t = 0; t < all.size(); ++t) all[t] = t;
  constexpr int kSeeds = 64;
  proto::SolverSettings plain = plain_settings();
  plain.bounces = 2;
  const Solution expected = scene.solve(plain);
  for (const SenderSeed seed : {SenderSeed::kWindow, SenderSeed::kReceiver}) {
    proto::SolverSettings s = windows_of(Undersampling::kMonteCarlo, 4, seed);
    s.bounces = 2;
    const SeedStudy study(scene, s, kSeeds, all);
    double mean = 0, area = 0, square = 0;
    std::uint32_t noisy = 0;
    for (const std::uint32_t t : all) {
      const double e = expected.light->irradiance(t).g, a = scene.texels().area_m2[t];
      mean += a * e, area += a;
      if (!(study.standard_error[t] > 1e-6 * e)) continue;
      square += std::pow((study.mean[t] - e) / study.standard_error[t], 2), ++noisy;
    }
    EXPECT_NEAR(study.area_mean, mean / area, 4 * study.area_standard_error);
    EXPECT_GT(noisy, all.size() / 2);
    // The squares of t with 63 degrees of freedom have the mean 63/61. The errors of texels go
    // together, so the mean over texels scatters by what one pattern does: by half or so.
    EXPECT_LT(square / noisy, 2);
  }
}

// Furnace: what windows of means send is what their texels sent, so the light errs no more than on
// texels as wide as the windows.
TEST(Mipmap, KeepsTheEnergyOfAFurnace) {
  const auto error = [](std::uint32_t texels, std::uint32_t window) {
    QuadScene room(3 * (texels + 4));
    room.add_room({-1, 0, -1}, {1, 2, 1}, {0.5f, 0.5f, 0.5f}, {0.5f, 0.5f, 0.5f});
    room.build();
    proto::SolverSettings s = windows_of(Undersampling::kMipmap, window);
    s.tolerance = 1e-5f;
    s.near_field = false;
    const Solution solution = room.solve(s);
    double light = 0, direct = 0;
    for (std::uint32_t t = 0; t < room.texels().size(); ++t) {
      light += double(room.texels().area_m2[t]) * double(solution.light->irradiance(t).g);
      direct += double(room.texels().area_m2[t]) * double(solution.light->direct[t].g);
    }
    return light / (direct / (1 - 0.5)) - 1;
  };
  const double coarse = error(6, 1), fine = error(12, 1), windows = error(12, 2);
  testing::Test::RecordProperty("error_percent", std::to_string(100 * coarse) + ", " +
                                                     std::to_string(100 * fine) + ", " +
                                                     std::to_string(100 * windows));
  EXPECT_LT(std::abs(windows), coarse);
}

// The leaves are a partition of the texels into aligned squares of one chart and side, and no texel
// of a leaf is farther from its mean than the threshold.
TEST(Quadtree, LeavesAreSquaresOfAlikeTexels) {
  const auto scene = crowded(64);
  const atlas::TextureGroup& t = scene->texels();
  const Solution direct = scene->solve([] {
    proto::SolverSettings s = plain_settings();
    s.bounces = 0;
    return s;
  }());
  std::size_t last = t.size() + 1;
  for (const float threshold : {0.f, 0.02f, 0.05f, 0.2f, 10.f}) {
    const Ready ready(*scene, tree_of(threshold, 16));
    const auto light = ready.radiosity(*direct.light);
    float k = 0;
    for (const math::Rgb& b : light) k = std::max(k, max_channel(b));
    const Windows windows(t, 16);
    const Quadtree tree(t, ready.parts.patches, windows, 16, light, threshold, {});
    std::vector<int> seen(t.size());
    std::uint32_t first = 0;
    for (const Quadtree::Leaf& leaf : tree.leaves()) {
      const auto texels = tree.texels(leaf);
      ASSERT_FALSE(texels.empty());
      EXPECT_GE(texels.front(), first);
      first = texels.front();
      math::Vec3d mean;
      double area = 0;
      for (const std::uint32_t i : texels) {
        ++seen[i];
        EXPECT_EQ(t.chart[i], t.chart[first]);
        EXPECT_EQ(t.is_back(i), t.is_back(first));
        EXPECT_EQ(t.x[i] / leaf.side, t.x[first] / leaf.side);
        EXPECT_EQ(t.y[i] / leaf.side, t.y[first] / leaf.side);
        mean += math::Vec3d{light[i].r, light[i].g, light[i].b} * double(t.area_m2[i]);
        area += double(t.area_m2[i]);
      }
      if (leaf.side == 1) continue;
      for (const std::uint32_t i : texels)
        EXPECT_LT(length(math::Vec3d{light[i].r, light[i].g, light[i].b} - mean * (1 / area)) / 2,
                  double(threshold * k) * (1 + 1e-5));
    }
    EXPECT_TRUE(std::ranges::all_of(seen, [](int n) { return n == 1; }));
    EXPECT_LT(tree.leaves().size(), last) << "fewer with every threshold";
    last = tree.leaves().size();
  }
  // Where everything is alike enough, leaves are as large as they may be.
  std::set<std::tuple<int, int, std::uint32_t, bool>> cells;
  for (std::uint32_t i = 0; i < t.size(); ++i)
    cells.insert({t.x[i] / 16, t.y[i] / 16, t.chart[i], t.is_back(i)});
  EXPECT_EQ(last, cells.size());
}

TEST(Quadtree, TheRampMergesMoreInLaterPasses) {
  const auto scene = crowded(64);
  proto::SolverSettings s = tree_of(0.02f);
  s.bounces = 4;
  s.tolerance = 0;
  const Solution level = scene->solve(s);
  s.subdivision_ramp = 0.05f;
  const Solution ramp = scene->solve(s);
  ASSERT_EQ(level.passes.size(), 5u);
  EXPECT_EQ(ramp.passes[1].rays, level.passes[1].rays);
  for (const std::size_t pass : {2, 3, 4})
    EXPECT_LT(ramp.passes[pass].rays, level.passes[pass].rays);
}

TEST(Senders, ThreadCountChangesNoBit) {
  const auto scene = crowded(48);
  for (proto::SolverSettings& s : strategies(4)) {
    s.bounces = 3;
    const Solution one = scene->solve(s, 1);
    for (const unsigned threads : {2u, 3u, 8u})
      EXPECT_TRUE(same_bits(one.light->indirect, scene->solve(s, threads).light->indirect))
          << int(s.undersampling);
  }
}

// Batches of a pass that another process prepared are the same bits.
TEST(Senders, PatchesOfAnotherProcessAreTheSameBits) {
  const test::ReadyScene box("cornell", 0, 48);
  for (const proto::SolverSettings& s : strategies(4)) {
    const World world = box.world(s), other_world = box.world(s);
    const auto solver = baker::make_solver(world), other = baker::make_solver(other_world);
    exec::ThreadPool pool(2), one(1);
    std::vector<proto::PassReport> done;
    std::shared_ptr<const lightmap::Lightmap> before;
    std::uint32_t compared = 0;
    baker::SolveHooks hooks;
    hooks.on_pass = [&](const PassPlan& plan, const proto::PassReport& report,
                        std::shared_ptr<const lightmap::Lightmap> after) -> proto::Expected<void> {
      if (before) {
        auto pass = other->next(done);
        EXPECT_TRUE(pass->prepare(*before, {one, {}}));
        lightmap::Lightmap again = *before;
        again.detach(plan.writes);
        for (std::uint32_t at = 0; at < again.size(); at += plan.batch_texels) {
          const auto patch =
              compute_patch(*pass, {at, std::min(at + plan.batch_texels, again.size())}, *before);
          EXPECT_TRUE(apply_patch(patch, again));
        }
        EXPECT_TRUE(same_bits(again.indirect, after->indirect)) << report.name;
        ++compared;
      }
      before = after;
      done.push_back(report);
      return {};
    };
    ASSERT_TRUE(baker::solve(world, *solver, pool, {}, hooks));
    EXPECT_GT(compared, 3u);
  }
}

// Emitters as senders: their light is that of shadow rays but for the width of texels, and it lies
// in the plane of indirect light.
TEST(Transport, MeetsExplicitLightAsTexelsShrink) {
  const auto solve = [](std::uint32_t page, proto::Emitters emitters, std::uint32_t bounces) {
    QuadScene room(page);
    room.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
    Quad lamp{{-0.6f, 1.5f, -0.6f}, {1.2f, 0, 0}, {0, 0, 1.2f}, {0.3f, 0.3f, 0.3f}, {5, 4, 3}};
    lamp.double_sided = true;
    room.add(lamp);
    room.build();
    proto::SolverSettings s = plain_settings();
    s.emitters = emitters;
    s.bounces = bounces;
    return room.solve(s);
  };
  for (const std::uint32_t bounces : {0u, 3u}) {
    double last = 0;
    for (const std::uint32_t page : {30u, 60u, 120u}) {
      if (page == 120 && bounces > 0) continue;
      const Solution expected = solve(page, proto::Emitters::kExplicit, bounces);
      const Solution transport = solve(page, proto::Emitters::kTransport, bounces);
      EXPECT_EQ(transport.passes.size(), expected.passes.size() + 1);
      EXPECT_TRUE(transport.passes.back().standard_error.has_value()) << "complete";
      for (const math::Rgb& e : transport.light->direct) ASSERT_TRUE(is_black(e));
      const double error = nrmse(transport, expected);
      testing::Test::RecordProperty(
          "nrmse_percent_" + std::to_string(bounces) + "_" + std::to_string(page),
          std::to_string(100 * error));
      if (last > 0) {
        EXPECT_LT(error, 0.7 * last);
      }
      last = error;
    }
    EXPECT_LT(last, 0.02);
  }
}

// All methods that let emitters send their own light end at that of shadow rays. Directions find
// emitters by chance, so their light has noise.
TEST(Transport, MeetsExplicitLightByEachMethodThatKnowsIt) {
  for (const auto& [method, most] :
       {std::pair(proto::Method::kMatrix, 0.01), std::pair(proto::Method::kLinks, 0.015),
        std::pair(proto::Method::kDirectional, 0.04)}) {
    QuadScene room(60);
    room.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
    Quad lamp{{-0.6f, 1.5f, -0.6f}, {1.2f, 0, 0}, {0, 0, 1.2f}, {0.3f, 0.3f, 0.3f}, {5, 4, 3}};
    lamp.double_sided = true;
    room.add(lamp);
    room.build();
    for (const std::uint32_t bounces : {0u, 16u}) {
      proto::SolverSettings s = plain_settings();
      s.method = method;
      s.bounces = bounces;
      s.samples = 1024;
      const Solution expected = room.solve(s);
      s.emitters = proto::Emitters::kTransport;
      const Solution transport = room.solve(s);
      for (const math::Rgb& e : transport.light->direct) ASSERT_TRUE(is_black(e));
      EXPECT_LT(nrmse(transport, expected), most) << proto::to_string(method) << ' ' << bounces;
    }
  }
}

// A target is reached by more directions, since there are no shadow rays to add; and no texel is
// interpolated, since the light has edges.
TEST(Transport, RoundsReachTheTargetOfAGather) {
  QuadScene room(60);
  room.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
  room.add({{-0.6f, 1.9f, -0.6f}, {1.2f, 0, 0}, {0, 0, 1.2f}, {0.3f, 0.3f, 0.3f}, {5, 4, 3}});
  room.build();
  proto::SolverSettings s;
  s.emitters = proto::Emitters::kTransport;
  proto::QualitySettings quality;
  quality.target_error = 0.05f;
  const Solution solution = room.solve(s, 2, quality);
  EXPECT_EQ(solution.passes.back().name, "round");
  EXPECT_LE(*solution.passes.back().standard_error, 0.05);
  for (std::uint32_t t = 0; t < solution.light->size(); ++t)
    ASSERT_TRUE(solution.light->gathers[t]) << t;
}

// Light without texels is sampled as ever.
TEST(Transport, LeavesLightWithoutTexelsToTheDirectPass) {
  QuadScene room(48);
  room.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
  room.build();
  scene::PunctualLight lamp;
  lamp.position = {0.5f, 1.5f, 0.3f};
  lamp.intensity = {100, 100, 100};
  room.scene().lights = {lamp};
  room.scene().rect_lights = {{{-0.5f, 1.9f, -0.5f}, {1, 0, 0}, {0, 0, 1}, {5, 5, 5}}};
  proto::SolverSettings s = plain_settings();
  s.bounces = 2;
  const Solution sampled = room.solve(s);
  s.emitters = proto::Emitters::kTransport;
  s.bounces = 1;
  const Solution transport = room.solve(s);
  EXPECT_TRUE(same_bits(transport.light->direct, sampled.light->direct));
  EXPECT_TRUE(same_bits(transport.light->indirect, sampled.light->indirect));
}

// RTRad's comparison after two passes [6.3.2]. Where surfaces touch, the view factor of a window
// hangs on which of its texels sends: the error sits there, and the figure with these texels is
// recorded.
TEST(Undersampling, StaysCloseToAllTexels) {
  const test::ReadyScene box("cornell", 0, 128);
  const auto solve = [&](proto::SolverSettings s) {
    s.bounces = 2;
    const World world = box.world(s);
    exec::ThreadPool pool(2);
    return test::must(baker::solve(world, *baker::make_solver(world), pool, {}));
  };
  const Solution all = solve(plain_settings());
  const World world = box.world(plain_settings());
  const std::vector<bool> near = touches(world, 2);
  const double share = double(std::ranges::count(near, true)) / double(near.size());
  RecordProperty("touching_percent", std::to_string(100 * share));
  EXPECT_LT(share, 0.25) << "what is left must mean something";
  for (const auto& [window, most] : {std::pair(2u, 0.03), std::pair(4u, 0.06)})
    for (const proto::SolverSettings& s : strategies(window)) {
      if (s.subdivision_threshold) continue;
      const Solution few = solve(s);
      const double error = nrmse(few, all, near);
      const std::string name = "nrmse_percent_" + std::to_string(int(s.undersampling)) + "_" +
                               std::to_string(int(s.sender_seed)) + "_" + std::to_string(window);
      RecordProperty(name, std::to_string(100 * error));
      RecordProperty("all_" + name, std::to_string(100 * nrmse(few, all)));
      EXPECT_LE(error, most) << name;
      EXPECT_LT(few.passes.back().rays, all.passes.back().rays);
    }
}

}  // namespace
}  // namespace kiln::solver::pairwise
