// A stop request is seen within a second, wherever the work is.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/exec/stop.h"
#include "tests/support/sanitizer.h"
#include "tests/support/scenes.h"
#include "tests/support/stop_timing.h"

namespace kiln::atlas {
namespace {

using namespace std::chrono_literals;

/// Hills of n x n cells; `loose`: no two triangles share an edge, so that each is a chart.
scene::Scene hills(std::uint32_t n, bool loose) {
  test::Mesh m;
  const auto at = [n](std::uint32_t x, std::uint32_t z) {
    const float u = float(x) / float(n), v = float(z) / float(n);
    return math::Vec3{20 * u, 2 * std::sin(9 * u) * std::cos(7 * v) + 3 * u * v, 20 * v};
  };
  const auto add = [&](math::Vec3 a, math::Vec3 b, math::Vec3 c, float lift) {
    const auto first = std::uint32_t(m.positions.size());
    for (const math::Vec3 p : {a, b, c}) m.positions.push_back(p + math::Vec3{0, lift, 0});
    m.triangles.push_back({first, first + 1, first + 2});
  };
  for (std::uint32_t z = 0; z < n; ++z) {
    for (std::uint32_t x = 0; x < n; ++x) {
      const float lift = loose ? 0.01f * float((x + z) % 3) : 0;
      add(at(x, z), at(x, z + 1), at(x + 1, z), lift);
      add(at(x + 1, z), at(x, z + 1), at(x + 1, z + 1), loose ? lift + 0.1f : 0);
    }
  }
  return test::SceneBuilder().part(m).build();
}

double seconds_after_stop(const scene::Scene& scene, std::chrono::milliseconds delay) {
  const auto work = [&](std::stop_token stop) { return build_atlas(scene, {}, stop); };
  return test::seconds_after_stop(work, delay);
}

constexpr std::uint32_t kCells = test::kSlowdown > 1 ? 300 : 1000;  // two triangles each

TEST(Stop, UnwrappingTwoMillionTrianglesEndsWithinASecond) {
  const scene::Scene scene = hills(kCells, false);
  for (const auto delay : {100ms, 400ms, 1000ms, 2000ms, 3000ms}) {
    EXPECT_LT(seconds_after_stop(scene, delay / test::kSlowdown), 1.0) << delay.count() << " ms";
  }
  EXPECT_GT(seconds_after_stop(scene, 100ms / test::kSlowdown), 0) << "was done before the stop";
}

TEST(Stop, TwoMillionChartsToo) {
  const scene::Scene scene = hills(kCells, true);
  for (const auto delay : {100ms, 1500ms, 4000ms}) {
    EXPECT_LT(seconds_after_stop(scene, delay / test::kSlowdown), 1.0) << delay.count() << " ms";
  }
}

TEST(Stop, RasterizingTwoMillionTriangles) {
  const scene::Scene scene = hills(kCells, false);
  const auto atlas = build_atlas(scene, {});
  ASSERT_TRUE(atlas) << atlas.error().message;
  test::expect_quick_stops([&](std::stop_token stop) { return rasterize(scene, *atlas, stop); });
}

TEST(Stop, TheStoppableSortIsAStableSort) {
  std::uint32_t state = 1;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> values;
  for (std::uint32_t i = 0; i < 300'001; ++i) {
    state = state * 1664525u + 1013904223u;
    values.emplace_back(state >> 20, i);
  }
  auto expected = values;
  const auto less = [](const auto& a, const auto& b) { return a.first < b.first; };
  std::stable_sort(expected.begin(), expected.end(), less);
  EXPECT_TRUE(exec::sort_unless_stopped(values, less, {}));
  EXPECT_EQ(values, expected);
  std::stop_source source;
  source.request_stop();
  EXPECT_FALSE(exec::sort_unless_stopped(values, less, source.get_token()));
}

}  // namespace
}  // namespace kiln::atlas
