// A wedge that splits a room: what is behind it stays exactly dark.
#include <gtest/gtest.h>

#include "baker/methods.h"
#include "baker/solve.h"
#include "tests/solver/every_method.h"
#include "tests/support/ready_scene.h"
#include "tests/support/sanitizer.h"

namespace kiln::solver {
namespace {

class Wedge : public testing::TestWithParam<proto::Method> {};

TEST_P(Wedge, LetsNoLightAcross) {
  const test::ReadyScene ready("cornell_layers", 0, 64);
  proto::SolverSettings settings;
  settings.method = GetParam();
  settings.samples = settings.direct_samples = 128 / test::kSlowdown;
  settings.bounces = 4;
  const World world = ready.world(settings);
  const auto solver = baker::make_solver(world);
  exec::ThreadPool pool(2);
  const auto solution = baker::solve(world, *solver, pool, {});
  ASSERT_TRUE(solution.has_value()) << solution.error().message;
  std::size_t dark = 0, lit = 0;
  for (std::uint32_t t = 0; t < ready.texels.size(); ++t) {
    const math::Vec3 p = ready.texels.position[t];
    const math::Rgb light = solution->light->irradiance(t);
    // The wedge's front, which ends the room, sees nothing of either half.
    const bool front = p.z > 2.795f;
    if (p.x > 0.049f && !front) {
      EXPECT_TRUE(is_black(light)) << "texel " << t << " at " << p.x << ", " << p.y << ", " << p.z;
      ++dark;
    } else {
      lit += is_black(light) ? 0 : 1;
    }
  }
  EXPECT_GT(dark, 800u);
  EXPECT_GT(lit, 800u);
}

INSTANTIATE_TEST_SUITE_P(OfEveryMethod, Wedge, testing::ValuesIn(all_methods()), method_name);

}  // namespace
}  // namespace kiln::solver
