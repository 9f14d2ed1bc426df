// pairwise: the orders of its bounces, remembered visibility, voxels and clamps.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "baker/lightmap/texel_patch.h"
#include "baker/solver/pairwise/passes.h"
#include "tests/solver/cornell_box.h"
#include "tests/support/quad_scene.h"

namespace kiln::solver::pairwise {
namespace {

using proto::Iteration;
using proto::VisibilityKind;

proto::SolverSettings pairwise_settings() {
  proto::SolverSettings s;
  s.method = proto::Method::kPairwise;
  s.direct_samples = 64;
  return s;
}

double mean_square_share(const Solution& a, const Solution& b) {
  double square = 0, mean = 0;
  for (std::uint32_t t = 0; t < a.light->size(); ++t) {
    const double x = double(a.light->irradiance(t).g), y = double(b.light->irradiance(t).g);
    square += (x - y) * (x - y);
    mean += x;
  }
  const double n = a.light->size();
  return std::sqrt(square / n) / (mean / n);
}

std::uint64_t rays_of(const Solution& s, const std::string& pass) {
  std::uint64_t rays = 0;
  for (const auto& p : s.passes)
    if (p.name == pass) rays += p.rays;
  return rays;
}
std::size_t count_of(const Solution& s, const std::string& pass) {
  return std::size_t(std::ranges::count_if(s.passes, [&](auto& p) { return p.name == pass; }));
}

// Whatever the order, the light that is left is the same: the solution of one system.
TEST(Iteration, AllOrdersEndAtTheSolutionOfTheSystem) {
  const auto box = cornell(32);
  proto::SolverSettings s = pairwise_settings();
  s.tolerance = 1e-5f;
  s.bounces = 64;
  proto::SolverSettings exact = s;
  exact.method = proto::Method::kMatrix;
  const Solution solved = box->solve(exact);
  for (const Iteration order :
       {Iteration::kJacobi, Iteration::kGaussSeidel, Iteration::kShooting}) {
    s.iteration = order;
    EXPECT_LT(mean_square_share(box->solve(s), solved), 1e-4) << int(order);
  }
}

TEST(Iteration, GaussSeidelNeedsFewerSweepsThanJacobi) {
  const auto box = cornell(32);
  proto::SolverSettings s = pairwise_settings();
  s.tolerance = 1e-4f;
  s.bounces = 64;
  const std::size_t jacobi = count_of(box->solve(s), "bounce");
  s.iteration = Iteration::kGaussSeidel;
  const std::size_t tiles = count_of(box->solve(s), "tile");
  EXPECT_EQ(tiles % kTiles, 0u);
  RecordProperty("sweeps", std::to_string(jacobi) + ", " + std::to_string(tiles / kTiles));
  EXPECT_LT(tiles / kTiles, jacobi);
}

// Each shot sends the light of the texels that have most of it, and light only grows.
TEST(Iteration, ShootingSendsTheBrightestFirst) {
  const auto box = cornell(32);
  proto::SolverSettings s = pairwise_settings();
  s.iteration = Iteration::kShooting;
  s.bounces = 4;
  const Solution shot = box->solve(s);
  const std::size_t shots = count_of(shot, "shoot");
  ASSERT_GT(shots, 4u);
  EXPECT_LE(shots, 4u * kShots);
  double first = 0, all = 0;
  std::size_t n = 0;
  for (const auto& p : shot.passes) {
    if (p.name != "shoot") continue;
    if (n++ < kShots / 4) first += p.residual;
    all += p.residual;
  }
  EXPECT_GT(first / all, 0.35) << "a quarter of a sweep sends far more than its share";
}

// Pairs are remembered without being asked for, too: each unordered pair is traced once
// [RTRad 4.7.4].
TEST(Remembered, VisibilityGivesTheSameBits) {
  const auto box = cornell(32);
  const std::uint64_t pairs = std::uint64_t(box->texels().size()) * box->texels().size();
  for (const Iteration order :
       {Iteration::kJacobi, Iteration::kGaussSeidel, Iteration::kShooting}) {
    proto::SolverSettings s = pairwise_settings();
    s.iteration = order;
    s.visibility = VisibilityKind::kRay;
    const Solution traced = box->solve(s);
    EXPECT_EQ(count_of(traced, "visibility"), 0u);
    for (const VisibilityKind kind : {VisibilityKind::kCached, VisibilityKind::kAuto}) {
      s.visibility = kind;
      const Solution remembered = box->solve(s);
      for (const char* name : {"bounce", "tile", "shoot"})
        EXPECT_EQ(rays_of(remembered, name), 0u) << "everything is remembered";
      EXPECT_GT(rays_of(remembered, "visibility"), 0u);
      EXPECT_LT(rays_of(remembered, "visibility"), pairs / 2) << "each pair is traced once";
      EXPECT_TRUE(same_bits(traced.light->indirect, remembered.light->indirect));
    }
  }
}

TEST(Remembered, ByItselfWhereTheMemoryHoldsAllPairs) {
  using enum VisibilityKind;
  proto::SolverSettings s = pairwise_settings();
  s.visibility_cache_mib = 16;
  EXPECT_EQ(visibility_kind(s, 16'384), kCached) << "16384 texels of 256 words are 16 MiB";
  EXPECT_EQ(visibility_kind(s, 16'385), kRay);
  const double all = pairwise_extra_memory(s, 16'384);
  EXPECT_EQ(all, double(16u << 20));
  EXPECT_GE(pairwise_extra_memory(s, 20'000), 0.9 * all) << "there may be fewer";
  EXPECT_EQ(pairwise_extra_memory(s, 40'000), 0);
  const auto kind = [&](auto change) {
    proto::SolverSettings other = s;
    change(other);
    return visibility_kind(other, 1000);
  };
  EXPECT_EQ(kind([](auto&) {}), kCached);
  EXPECT_EQ(kind([](auto& o) { o.visibility = kVoxel; }), kVoxel);
  EXPECT_EQ(kind([](auto& o) { o.bounces = 0; }), kRay) << "there is nothing to remember for";
  EXPECT_EQ(kind([](auto& o) { o.pair_samples = 2; }), kRay);
  EXPECT_EQ(kind([](auto& o) { o.undersampling = proto::Undersampling::kStride; }), kRay);
  EXPECT_EQ(kind([](auto& o) { o.subdivision_threshold = 0.05f; }), kRay);
  EXPECT_EQ(kind([](auto& o) { o.method = proto::Method::kMatrix; }), kRay);
  EXPECT_EQ(kind([](auto& o) { o.method = proto::Method::kLinks; }), kRay);
  // Half of one pass in place of all bounces.
  proto::SolverSettings traced = s;
  traced.visibility = kRay;
  EXPECT_EQ(bake_rays(traced, 10'000, 1, 10), 20 * bake_rays(s, 10'000, 1, 10));
  traced.visibility = kCached;
  traced.visibility_cache_mib = 3;  // of 6
  const double some = bake_rays(traced, 10'000, 1, 10) / bake_rays(s, 10'000, 1, 10);
  EXPECT_NEAR(some, 0.5 + 0.5 * 20, 0.1);
}

TEST(Remembered, WhatFindsNoPlaceIsTracedAgain) {
  const auto box = cornell(128);
  proto::SolverSettings s = pairwise_settings();
  s.bounces = 1;
  s.visibility = VisibilityKind::kRay;
  const Solution traced = box->solve(s);
  s.visibility = VisibilityKind::kCached;
  s.visibility_cache_mib = 1;
  const std::uint32_t n = box->texels().size();
  const PairLayout layout(n, PairLayout::words_for(n, 1u << 20));
  ASSERT_LT(layout.coverage(), 1) << n << " texels";
  const Solution some = box->solve(s);
  const double share = double(rays_of(some, "bounce")) / double(rays_of(traced, "bounce"));
  EXPECT_GT(share, 0);
  EXPECT_LT(share, 1);
  // What a segment that grazes an edge meets can hang on the packet that it is traced in.
  std::uint32_t grazing = 0;
  for (std::uint32_t t = 0; t < n; ++t) {
    const float expected = traced.light->indirect[t].g;
    grazing += expected != some.light->indirect[t].g;
    ASSERT_NEAR(expected, some.light->indirect[t].g, 1e-3f * expected) << t;
  }
  EXPECT_LT(grazing, n / 1000);
}

TEST(Remembered, EachPairHasOneBitAndEachTexelItsWords) {
  for (const std::uint32_t n : {1u, 2u, 3u, 64u, 65u, 130u}) {
    const std::uint32_t words = PairLayout::words_for(n, 1u << 30);
    const PairLayout layout(n, words);
    EXPECT_EQ(layout.coverage(), 1) << n;
    std::vector<std::vector<int>> used(n, std::vector<int>(32 * words));
    for (std::uint32_t i = 0; i < n; ++i)
      for (std::uint32_t j = 0; j < n; ++j) {
        if (i == j) continue;
        PairLayout::Place a, b;
        ASSERT_TRUE(layout.find(i, j, a)) << n << ": " << i << ", " << j;
        ASSERT_TRUE(layout.find(j, i, b));
        ASSERT_EQ(a.texel, b.texel);
        ASSERT_EQ(a.bit, b.bit);
        ++used[a.texel][a.bit];
      }
    for (const auto& bits : used)
      for (const int times : bits) ASSERT_TRUE(times == 0 || times == 2) << n;
  }
}

TEST(VoxelSettings, AreObeyed) {
  const auto box = cornell(32);
  proto::SolverSettings s = pairwise_settings();
  const Solution rays = box->solve(s);
  s.visibility = VisibilityKind::kVoxel;
  s.voxel_ratio = 0;
  EXPECT_EQ(mean_square_share(box->solve(s), rays), 0) << "no segment marches";
  s.voxel_ratio = 1;
  s.voxel_grid = 16;
  const double coarse = mean_square_share(box->solve(s), rays);
  s.voxel_grid = 128;
  const double fine = mean_square_share(box->solve(s), rays);
  s.voxel_march = proto::VoxelMarch::kFixedSteps;
  const double steps = mean_square_share(box->solve(s), rays);
  RecordProperty("nrmse", std::to_string(coarse) + ", " + std::to_string(fine) + "; steps " +
                              std::to_string(steps));
  EXPECT_GT(coarse, 0);
  EXPECT_LT(fine, coarse);
  EXPECT_NE(steps, fine);
}

// Clamps take energy, and say how much.
TEST(ClampedLight, IsToldTexelByTexel) {
  const auto box = cornell(32);
  proto::SolverSettings s = pairwise_settings();
  s.bounces = 1;
  const Solution whole = box->solve(s);
  for (const bool by_factor : {false, true}) {
    proto::SolverSettings clamped = s;
    (by_factor ? clamped.max_view_factor : clamped.max_contribution) = 0.02f;
    const Solution less = box->solve(clamped);
    double lost = 0;
    for (std::uint32_t t = 0; t < less.light->size(); ++t) {
      const float gap = luminance(whole.light->indirect[t]) - luminance(less.light->indirect[t]);
      ASSERT_NEAR(less.light->clamped[t], gap, 1e-5f + 1e-4f * luminance(whole.light->indirect[t]));
      lost += double(less.light->clamped[t]);
    }
    EXPECT_GT(lost, 0) << by_factor;
  }
  EXPECT_EQ(whole.light->clamped.size(), 0u);
}

TEST(BatchTexels, ChangesNoBit) {
  const auto box = cornell(32);
  proto::SolverSettings s = pairwise_settings();
  const Solution automatic = box->solve(s);
  s.batch_texels = 7;
  const Solution small = box->solve(s);
  for (std::uint32_t t = 0; t < small.light->size(); ++t)
    ASSERT_EQ(automatic.light->indirect[t].g, small.light->indirect[t].g);
}

}  // namespace
}  // namespace kiln::solver::pairwise
