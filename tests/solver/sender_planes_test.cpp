// Planes of what chooses senders: they agree with the senders that a bounce has.
#include "baker/solver/pairwise/sender_planes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>

#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pairwise/quadtree.h"
#include "tests/support/ready_scene.h"
#include "tests/support/stop_timing.h"

namespace kiln::solver::pairwise {
namespace {

using proto::Undersampling;

/// A ball that bends within windows, with light that differs from texel to texel.
struct LitBall {
  test::ReadyScene ball{"bumpy_ball", 12, 64};
  std::vector<math::Rgb> radiosity;

  LitBall() {
    for (std::uint32_t t = 0; t < ball.texels.size(); ++t) {
      const math::Vec3 at = ball.texels.position[t];
      radiosity.push_back({1 + std::abs(at.x), 2 + at.y * at.y, t % 7 == 0 ? 3.f : 1.f});
    }
  }
  World world(proto::SolverSettings s) const {
    s.method = proto::Method::kPairwise;
    return ball.world(s);
  }
};

proto::SolverSettings with_windows(Undersampling kind, std::uint32_t window) {
  proto::SolverSettings s;
  s.undersampling = kind;
  s.window = window;
  return s;
}

TEST(SenderPlanes, MeansAreThoseOfTheSendersOfAMipmap) {
  const LitBall lit;
  for (const std::uint32_t window : {1u, 3u, 8u}) {
    const World world = lit.world(with_windows(Undersampling::kMipmap, window));
    const Parts parts(world);
    const auto means = window_means(world, lit.radiosity, {});
    ASSERT_TRUE(means);
    const Senders senders = *parts.senders.pick(lit.radiosity, 0, {});
    for (const Sender& sender : senders.list)
      EXPECT_EQ((*means)[sender.texel], sender.radiosity) << window;
    // All texels of a window, a chart and a side have one.
    std::set<std::tuple<int, int, int, std::uint32_t, bool, float>> cells;
    const atlas::TextureGroup& t = lit.ball.texels;
    for (std::uint32_t i = 0; i < t.size(); ++i)
      cells.insert(
          {t.page[i], t.x[i] / window, t.y[i] / window, t.chart[i], t.is_back(i), (*means)[i].b});
    EXPECT_EQ(cells.size(), senders.list.size());
  }
}

TEST(SenderPlanes, SidesAreThoseOfTheLeavesOfTheQuadtree) {
  const LitBall lit;
  for (const std::optional<float> threshold : {std::optional(0.2f), std::optional<float>()}) {
    proto::SolverSettings s;
    s.subdivision_threshold = threshold;
    s.subdivision_max_node = 16;
    const World world = lit.world(s);
    const Parts parts(world);
    const Windows windows(lit.ball.texels, 16);
    const Quadtree tree(lit.ball.texels, parts.patches, windows, 16, lit.radiosity,
                        threshold.value_or(0.05f), {});
    const auto sides = leaf_sides(world, lit.radiosity, {});
    ASSERT_TRUE(sides);
    std::set<int> found;
    for (const Quadtree::Leaf& leaf : tree.leaves())
      for (const std::uint32_t t : tree.texels(leaf)) {
        EXPECT_EQ((*sides)[t], leaf.side);
        found.insert((*sides)[t]);
      }
    EXPECT_GT(found.size(), 1u) << "leaves of several sizes";
  }
}

TEST(SenderPlanes, AreasAreThoseOfTheSendersOfTheFirstBounce) {
  const LitBall lit;
  const atlas::TextureGroup& t = lit.ball.texels;
  double surface = 0;
  for (const float a : t.area_m2) surface += double(a);
  std::vector<proto::SolverSettings> all;
  for (const Undersampling kind :
       {Undersampling::kStride, Undersampling::kMonteCarlo, Undersampling::kMipmap})
    all.push_back(with_windows(kind, 4));
  all.push_back(all[1]);
  all.back().sender_seed = proto::SenderSeed::kReceiver;
  all.emplace_back().subdivision_threshold = 0.2f;
  for (const proto::SolverSettings& s : all) {
    const World world = lit.world(s);
    const auto areas = sent_areas(world, lit.radiosity, {});
    ASSERT_TRUE(areas);
    double sum = 0;
    std::uint32_t send = 0;
    for (const float a : *areas) sum += double(a), send += a > 0;
    EXPECT_NEAR(sum, surface, 1e-5 * surface) << int(s.undersampling);
    EXPECT_LT(send, t.size() / 2) << "few texels send";
    EXPECT_GT(send, t.size() / 100);
  }
  // Every texel sends, unless it is black.
  std::vector<math::Rgb> light = lit.radiosity;
  light[5] = {};
  const auto own = sent_areas(lit.world({}), light, {});
  ASSERT_TRUE(own);
  for (std::uint32_t i = 0; i < t.size(); ++i) EXPECT_EQ((*own)[i], i == 5 ? 0 : t.area_m2[i]);
}

TEST(SenderPlanes, RadiosityIsWhatLeavesATexel) {
  const test::ReadyScene box("cornell", 0, 32);
  proto::SolverSettings s;
  s.method = proto::Method::kPairwise;
  s.reflectivity_factor = 0.5f;
  const auto two = [](std::uint32_t t) { return math::Rgb{2, 4, float(t)}; };
  const auto reflected = texel_radiosity(box.world(s), two, {});
  s.emitters = proto::Emitters::kTransport;
  const auto all = texel_radiosity(box.world(s), two, {});
  ASSERT_TRUE(reflected && all);
  std::uint32_t shining = 0;
  for (std::uint32_t t = 0; t < box.texels.size(); ++t) {
    EXPECT_EQ((*reflected)[t], box.texels.albedo[t] * 0.5f * two(t));
    const math::Rgb emitted = (*all)[t] - (*reflected)[t];
    shining += emitted.r > 1;
    const math::Rgb lamp = box.scene.material_of(box.texels.triangle[t]).emission;
    EXPECT_NEAR(emitted.r, math::kPi * lamp.r, 1e-3f * lamp.r);
  }
  EXPECT_GT(shining, 0u);
}

TEST(SenderPlanes, AreStoppedWithinASecond) {
  const test::ReadyScene box("cornell", 0, 512);
  const World world = box.world(with_windows(Undersampling::kMipmap, 4));
  const auto all = [&](const std::stop_token& stop) -> proto::Expected<void> {
    const auto light = texel_radiosity(
        world,
        [](std::uint32_t t) {
          return math::Rgb{float(t % 64), 1, 1};
        },
        stop);
    if (light && window_means(world, *light, stop) && leaf_sides(world, *light, stop) &&
        sent_areas(world, *light, stop))
      return {};
    return proto::canceled();
  };
  test::expect_quick_stops(all);
}

}  // namespace
}  // namespace kiln::solver::pairwise
