// Hierarchical links: their tree, what they leave out, and what they cost.
#include "baker/solver/links/links.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "baker/methods.h"
#include "baker/solver/links/link_tree.h"
#include "baker/solver/pairwise/parts.h"
#include "tests/solver/cornell_box.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver::links {
namespace {

proto::SolverSettings settings_for(proto::Method method, float link_error = 0.003f) {
  proto::SolverSettings s;
  s.method = method;
  s.bounces = 2;
  s.tolerance = 0;
  s.direct_samples = 64;
  s.link_error = link_error;
  return s;
}

double nrmse(const Solution& a, const Solution& b) {
  double square = 0, mean = 0;
  for (std::uint32_t t = 0; t < b.light->size(); ++t) {
    const math::Rgb d = a.light->irradiance(t) - b.light->irradiance(t), e = b.light->irradiance(t);
    square += double(dot(math::Vec3{d.r, d.g, d.b}, math::Vec3{d.r, d.g, d.b})) / 3;
    mean += double(e.r + e.g + e.b) / 3;
  }
  return std::sqrt(square * b.light->size()) / mean;
}

// Every texel is in the root once, the children of a group have its texels, and the receivers of a
// range have at least those of the range, once each.
TEST(LinkTree, HoldsEveryTexelOnce) {
  const test::ReadyScene room("octagon_textured", 0, 96);
  const World world = room.world(settings_for(proto::Method::kLinks));
  const pairwise::Parts parts(world);
  const LinkTree tree(world.texels, parts.patches);
  const auto all = tree.texels(tree.root());
  EXPECT_EQ(all.size(), world.texels.size());
  EXPECT_EQ(std::set<std::uint32_t>(all.begin(), all.end()).size(), all.size());
  for (LinkTree::Id group = 0; group < tree.groups(); ++group) {
    std::vector<std::uint32_t> inside;
    ASSERT_GE(tree.children(group), 1u);
    for (std::uint32_t k = 0; k < tree.children(group); ++k) {
      const LinkTree::Id child = tree.child(group, k);
      if (tree.is_texel(child)) {
        inside.push_back(tree.texel(child));
      } else {
        ASSERT_GT(child, group);
        inside.insert(inside.end(), tree.texels(child).begin(), tree.texels(child).end());
      }
    }
    ASSERT_TRUE(std::ranges::equal(inside, tree.texels(group))) << group;
    const LinkTree::Bounds& b = tree.bounds(group);
    for (const std::uint32_t t : tree.texels(group))
      ASSERT_LE(length(world.texels.position[t] - b.center), b.radius * 1.0001f + 1e-6f);
  }
  const atlas::TexelRange range{100, 400};
  std::multiset<std::uint32_t> received;
  for (const LinkTree::Id id : tree.receivers(range)) {
    if (tree.is_texel(id)) {
      received.insert(tree.texel(id));
      continue;
    }
    EXPECT_LE(tree.texels(id).size(), LinkTree::kReceiverSide * LinkTree::kReceiverSide);
    received.insert(tree.texels(id).begin(), tree.texels(id).end());
  }
  for (std::uint32_t t = range.begin; t < range.end; ++t) EXPECT_EQ(received.count(t), 1u) << t;
}

// A bound of nothing links single texels alone: the light is that of pairwise, summed in another
// order. A wider bound costs less and errs more, and stays unbiased to about that.
TEST(Links, EndAtTheLightOfAllPairs) {
  const test::ReadyScene box("cornell", 0, 64);
  exec::ThreadPool pool(2);
  const auto bake = [&](const proto::SolverSettings& s) {
    const World world = box.world(s);
    const auto solver = baker::make_solver(world);
    return test::must(baker::solve(world, *solver, pool, {}));
  };
  const Solution pairs = bake(settings_for(proto::Method::kPairwise));
  double last = 0;
  std::uint64_t rays = ~std::uint64_t(0);
  for (const float error : {1e-6f, 0.003f, 0.03f}) {
    const Solution links = bake(settings_for(proto::Method::kLinks, error));
    const double off = nrmse(links, pairs);
    testing::Test::RecordProperty("nrmse_percent_" + std::to_string(error),
                                  std::to_string(100 * off));
    EXPECT_GE(off, last);
    if (error == 1e-6f) {
      EXPECT_LT(off, 1e-3);
    }
    if (error == 0.003f) {
      EXPECT_LT(off, 0.01);
    }
    EXPECT_LT(links.passes.back().rays, rays);
    last = off, rays = links.passes.back().rays;
  }
}

// Four times the texels take about four times the rays, where all pairs take sixteen times.
TEST(Links, CostGrowsAsTheTexelsDo) {
  exec::ThreadPool pool(2);
  double texels[2], rays[2];
  for (const int fine : {0, 1}) {
    const test::ReadyScene box("cornell", 0, fine ? 256 : 128);
    proto::SolverSettings s = settings_for(proto::Method::kLinks, 0.03f);
    s.bounces = 1;
    const World world = box.world(s);
    const auto solver = baker::make_solver(world);
    const Solution solution = test::must(baker::solve(world, *solver, pool, {}));
    texels[fine] = solution.light->size();
    rays[fine] = double(solution.passes.back().rays);
  }
  const double exponent = std::log(rays[1] / rays[0]) / std::log(texels[1] / texels[0]);
  RecordProperty("exponent", std::to_string(exponent));
  EXPECT_LT(exponent, 1.3);
  EXPECT_GT(exponent, 0.7);
}

}  // namespace
}  // namespace kiln::solver::links
