// What the halves of the samples say of the error, against the scatter between seeds.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "baker/exec/thread_pool.h"
#include "baker/methods.h"
#include "baker/solve.h"
#include "tests/support/ready_scene.h"
#include "tests/support/sanitizer.h"

namespace kiln::sampling {
namespace {

/// Root mean squares over the texels of one kind of light, luminance.
struct Seeds {
  double scatter = 0, told = 0, mean = 0;
  double farthest = 0;  ///< of any texel and seed from the mean of its seeds
};

struct Parts {
  Seeds direct, indirect;
};

Parts by_seeds(const test::ReadyScene& ready, proto::SolverSettings settings, int seeds) {
  const std::size_t n = ready.texels.size();
  exec::ThreadPool pool(2);
  std::vector<std::vector<double>> direct, indirect;  // by seed, then texel
  Parts parts;
  for (int i = 0; i < seeds; ++i) {
    settings.seed = 40 + std::uint64_t(i);
    const solver::World world = ready.world(settings);
    const auto solver = baker::make_solver(world);
    const auto solution = baker::solve(world, *solver, pool, {});
    const lightmap::Lightmap& light = *test::must(solution).light;
    auto& d = direct.emplace_back(n);
    auto& r = indirect.emplace_back(n);
    for (std::uint32_t t = 0; t < n; ++t) {
      d[t] = double(luminance(light.direct[t])), r[t] = double(luminance(light.indirect[t]));
      parts.direct.told += std::pow(double(light.direct_difference[t]), 2) / (seeds * double(n));
      parts.indirect.told +=
          std::pow(double(light.indirect_difference[t]), 2) / (seeds * double(n));
    }
  }
  const auto finish = [&](const std::vector<std::vector<double>>& by_seed, Seeds& s) {
    for (std::size_t t = 0; t < n; ++t) {
      double mean = 0;
      for (const auto& light : by_seed) mean += light[t] / seeds;
      for (const auto& light : by_seed) {
        s.scatter += std::pow(light[t] - mean, 2) / ((seeds - 1) * double(n));
        s.farthest = std::max(s.farthest, std::abs(light[t] - mean));
      }
      s.mean += mean / double(n);
    }
    s.scatter = std::sqrt(s.scatter), s.told = std::sqrt(s.told);
  };
  finish(direct, parts.direct);
  finish(indirect, parts.indirect);
  return parts;
}

proto::SolverSettings samples(std::uint32_t n, std::uint32_t bounces) {
  proto::SolverSettings s;
  s.samples = s.direct_samples = n;
  s.bounces = bounces;
  s.coarse_indirect = false;
  return s;
}

class Spreads : public testing::TestWithParam<std::string> {};

TEST_P(Spreads, AreTheErrorBetweenSeeds) {
  const test::ReadyScene ready(GetParam(), 24, 64);
  for (const std::uint32_t n : {32u, 128u}) {
    const Parts parts = by_seeds(ready, samples(n, 2), 8);
    const auto check = [&](const Seeds& s, const std::string& name) {
      const double ratio = s.told / s.scatter;
      RecordProperty(name + "_told_over_scatter_" + std::to_string(n), std::to_string(ratio));
      EXPECT_GT(ratio, 0.8) << name << " by " << n;
      EXPECT_LT(ratio, 1.25) << name << " by " << n;
    };
    if (parts.direct.scatter > 1e-4 * parts.direct.mean) check(parts.direct, "direct");
    check(parts.indirect, "indirect");
  }
}

INSTANTIATE_TEST_SUITE_P(OfEveryLight, Spreads,
                         testing::Values("cornell", "bumpy_ball", "many_lights", "room_textured",
                                         "courtyard"),
                         [](const auto& of) { return of.param; });

// Where a row of texels is half above the plane of a lamp, what its lower half sees of it must not
// be left to the few samples that go by power alone: those texels would sparkle.
TEST(ManyLights, NoTexelStraysFarFromItsMean) {
  const test::ReadyScene ready("many_lights", 0, 160);
  const Seeds direct = by_seeds(ready, samples(64, 0), 12 / test::kSlowdown + 2).direct;
  RecordProperty("farthest_over_mean", std::to_string(direct.farthest / direct.mean));
  EXPECT_LT(direct.farthest, 1.5 * direct.mean);
}

}  // namespace
}  // namespace kiln::sampling
