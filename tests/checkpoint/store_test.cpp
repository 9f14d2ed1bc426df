// A solver that keeps fewer hits than it has samples follows the rest at the end: it resumes, too.
#include "baker/checkpoint/store.h"

#include <gtest/gtest.h>

#include "baker/methods.h"
#include "baker/solve.h"
#include "baker/solver/gather/gather.h"
#include "tests/support/quad_scene.h"
#include "tests/support/temp_files.h"

namespace kiln::checkpoint {
namespace {

TEST(Checkpoint, RoundsAreReachedFromAnyPass) {
  solver::QuadScene room(48);
  room.add_room({0, 0, 0}, {2, 2, 2}, {0.6f, 0.5f, 0.4f});
  room.add({{0.8f, 1.99f, 0.8f}, {0.4f, 0, 0}, {0, 0, 0.4f}, {}, {10, 10, 10}});
  room.build();
  proto::SolverSettings settings;
  settings.samples = 64;
  settings.direct_samples = 64;
  const auto rays = trace::RayScene::build(room.scene());
  const light::LightSet lights(room.scene());
  const trace::TexelLookup lookup(room.scene(), room.atlas(), room.texels());
  const solver::World world{
      room.scene(), room.atlas(), room.texels(), *rays,
      lights,       lookup,       settings,      baker::sample_plan(settings, {})};
  exec::ThreadPool pool(2);
  const auto solver_of = [&] { return solver::gather::make_gather_solver(world, 1); };
  const auto whole = baker::solve(world, *solver_of(), pool, {});
  ASSERT_TRUE(whole);
  ASSERT_EQ(whole->passes.back().name, "round");

  for (std::size_t cut = 1; cut <= whole->passes.size(); ++cut) {
    const test::TempFolder folder;
    const auto first = solver_of();
    std::vector<proto::PassReport> passes;
    std::stop_source stop;
    baker::SolveHooks hooks;
    hooks.on_pass = [&](const solver::PassPlan& pass, const proto::PassReport& report,
                        std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
      passes.push_back(report);
      if (fills_shared(pass) && !pass.completes) {
        EXPECT_TRUE(write_shared(folder.path(), "key", *light));
      }
      EXPECT_TRUE(write_checkpoint(folder.path(), "key", passes, *light));
      if (passes.size() == cut) stop.request_stop();
      return {};
    };
    (void)baker::solve(world, *first, pool, stop.get_token(), hooks);
    ASSERT_EQ(passes.size(), cut);

    const auto second = solver_of();
    auto start = read_checkpoint(folder.path(), "key", *second, room.texels().size());
    ASSERT_TRUE(start) << start.error().message;
    ASSERT_TRUE(*start);
    const auto rest = baker::solve(world, *second, pool, {}, {}, std::move(**start));
    ASSERT_TRUE(rest);
    EXPECT_EQ(rest->passes.size(), whole->passes.size());
    EXPECT_TRUE(solver::same_bits(rest->light->indirect, whole->light->indirect)) << cut;
    EXPECT_TRUE(solver::same_bits(rest->light->direct, whole->light->direct)) << cut;

    EXPECT_EQ(read_checkpoint(folder.path(), "other", *second, room.texels().size()).error().code,
              "invalid_checkpoint");
    EXPECT_EQ(read_checkpoint(folder.path(), "key", *second, 7).error().code, "invalid_checkpoint");
    remove_checkpoints(folder.path());
    const auto none = read_checkpoint(folder.path(), "key", *second, room.texels().size());
    EXPECT_TRUE(none && !*none);
  }
}

}  // namespace
}  // namespace kiln::checkpoint
