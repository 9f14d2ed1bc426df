// A bake that was cut in the middle of a pass computes no batch of it twice that was kept.
#include "baker/checkpoint/parts.h"

#include <gtest/gtest.h>

#include <climits>
#include <fstream>
#include <functional>
#include <mutex>
#include <set>

#include "baker/checkpoint/store.h"
#include "baker/methods.h"
#include "baker/solve.h"
#include "baker/solver/gather/gather.h"
#include "tests/support/quad_scene.h"
#include "tests/support/temp_files.h"

namespace kiln::checkpoint {
namespace {

/// (pass, first texel) of the batches that ran.
using Ran = std::set<std::pair<std::uint32_t, std::uint32_t>>;

/// A pass of another solver that notes which batches run.
class CountedPass final : public solver::Pass {
 public:
  CountedPass(std::unique_ptr<solver::Pass> pass, Ran& ran, std::mutex& mutex)
      : Pass(pass->plan()), pass_(std::move(pass)), ran_(ran), mutex_(mutex) {}
  bool prepare(const lightmap::Lightmap& before, const exec::Workers& w) override {
    const bool whole = pass_->prepare(before, w);
    plan_ = pass_->plan();
    return whole;
  }
  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    {
      const std::lock_guard lock(mutex_);
      EXPECT_TRUE(ran_.emplace(plan().index, range.begin).second) << "twice in one attempt";
    }
    return pass_->run(range, before, after);
  }
  bool finish(lightmap::Lightmap& after, const exec::Workers& w) override {
    return pass_->finish(after, w);
  }

 private:
  std::unique_ptr<solver::Pass> pass_;
  Ran& ran_;
  std::mutex& mutex_;
};

class Counted final : public solver::Solver {
 public:
  explicit Counted(std::unique_ptr<solver::Solver> solver) : solver_(std::move(solver)) {}
  mutable Ran ran;

  std::vector<lightmap::PlaneSpec> state_planes() const override { return solver_->state_planes(); }
  std::unique_ptr<solver::Pass> next(std::span<const proto::PassReport> done) const override {
    auto pass = solver_->next(done);
    return pass ? std::make_unique<CountedPass>(std::move(pass), ran, mutex_) : nullptr;
  }
  solver::Forecast forecast() const override { return solver_->forecast(); }
  const solver::SamplePlan& samples() const override { return solver_->samples(); }

 private:
  std::unique_ptr<solver::Solver> solver_;
  mutable std::mutex mutex_;
};

class Parts : public ::testing::Test {
 protected:
  solver::QuadScene room_{96};
  std::optional<trace::RayScene> rays_;
  std::optional<light::LightSet> lights_;
  std::optional<trace::TexelLookup> lookup_;
  std::optional<solver::World> world_;
  test::TempFolder folder_;
  exec::ThreadPool pool_{1};  ///< so that every batch makes a part

  Parts() {
    room_.add_room({0, 0, 0}, {2, 2, 2}, {0.6f, 0.5f, 0.4f});
    room_.add({{0.8f, 1.99f, 0.8f}, {0.4f, 0, 0}, {0, 0, 0.4f}, {}, {10, 10, 10}});
    room_.build();
    auto rays = trace::RayScene::build(room_.scene());
    rays_.emplace(std::move(*rays));
    lights_.emplace(room_.scene());
    lookup_.emplace(room_.scene(), room_.atlas(), room_.texels());
    proto::SolverSettings settings;
    settings.samples = 128;
    settings.direct_samples = 32;
    world_.emplace(solver::World{room_.scene(), room_.atlas(), room_.texels(), *rays_, *lights_,
                                 *lookup_, settings, baker::sample_plan(settings, {})});
  }
  std::uint32_t texels() const { return room_.texels().size(); }
  /// 64 of the 128 directions are remembered, so that a round follows.
  std::unique_ptr<Counted> solver() const {
    return std::make_unique<Counted>(
        solver::gather::make_gather_solver(*world_, 4ull * 64 * texels()));
  }

  struct Attempt {
    std::unique_ptr<Counted> solver;
    proto::Expected<baker::Solution> solution;
    solver::PassProgress restored;
    std::uint32_t restored_pass = 0;
    int parts = 0;
    solver::PassProgress last;  ///< of the part that was kept last
    std::uint32_t last_pass = 0;
    std::vector<std::uint32_t> ends;  ///< texels before the end of each part
  };
  static constexpr int kAll = INT_MAX;
  /// Goes on from the folder, with a part behind each batch, and stops after so many. 0: without.
  Attempt run(int parts) {
    Attempt a{solver(), proto::fail("x", "y"), {}, 0, 0, {}, 0, {}};
    auto start = read_checkpoint(folder_.path(), "key", *a.solver, texels());
    EXPECT_TRUE(start);
    std::vector<proto::PassReport> passes;
    if (*start) passes = (*start)->passes;
    const auto known = passes.size();
    std::stop_source stop;
    std::uint32_t number = 0;
    solver::PassProgress kept;
    baker::SolveHooks hooks;
    hooks.part_time = std::chrono::seconds(parts > 0 ? 0 : 1000);
    hooks.restore = [&](const solver::Pass& pass, const lightmap::Lightmap& before,
                        lightmap::Lightmap& after) {
      number = 0, kept = {};
      if (pass.plan().index != known) return kept;
      const auto stored = read_parts(folder_.path(), "key", pass.plan(), before, after);
      number = stored.count;
      a.restored_pass = pass.plan().index;
      return kept = a.restored = stored.progress;
    };
    hooks.on_part = [&](const solver::PassPlan& plan,
                        const std::shared_ptr<const lightmap::Lightmap>& after,
                        const solver::PassProgress& now) {
      lightmap::PatchHead head;
      head.pass = plan.index;
      head.texels = {kept.texels, now.texels};
      head.writes = plan.writes;
      head.rays = now.rays - kept.rays;
      head.seconds = now.seconds - kept.seconds;
      EXPECT_TRUE(write_part(folder_.path(), "key", number++, head, *after));
      kept = a.last = now;
      a.last_pass = plan.index;
      a.ends.push_back(now.texels);
      if (++a.parts == parts) stop.request_stop();
    };
    hooks.on_pass = [&](const solver::PassPlan& plan, const proto::PassReport& report,
                        std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
      passes.push_back(report);
      if (fills_shared(plan) && !plan.completes) {
        EXPECT_TRUE(write_shared(folder_.path(), "key", *light));
      }
      EXPECT_TRUE(write_checkpoint(folder_.path(), "key", passes, *light));
      return {};
    };
    a.solution = baker::solve(*world_, *a.solver, pool_, stop.get_token(), hooks,
                              start->value_or(solver::SolveStart{}));
    return a;
  }
};

TEST_F(Parts, NoBatchIsComputedAgainAndNoBitDiffers) {
  const Attempt whole = run(kAll);
  ASSERT_TRUE(whole.solution);
  ASSERT_GT(whole.parts, 40);
  ASSERT_EQ(whole.solution->passes.back().name, "round");
  std::set<std::string> resumed;
  for (int cut = 1; cut < whole.parts; cut += 9) {
    remove_checkpoints(folder_.path());
    const Attempt first = run(cut);
    ASSERT_FALSE(first.solution);
    const Attempt rest = run(0);
    ASSERT_TRUE(rest.solution) << cut;
    EXPECT_EQ(rest.restored_pass, first.last_pass);
    EXPECT_EQ(rest.restored.texels, first.last.texels);
    EXPECT_EQ(rest.restored.rays, first.last.rays);
    for (const auto& [pass, texel] : rest.solver->ran)
      EXPECT_TRUE(pass > first.last_pass || texel >= first.last.texels) << pass << " " << texel;
    for (std::size_t p = 0; p < whole.solution->passes.size(); ++p)
      EXPECT_EQ(rest.solution->passes[p].rays, whole.solution->passes[p].rays);
    EXPECT_TRUE(solver::same_bits(rest.solution->light->direct, whole.solution->light->direct))
        << cut;
    EXPECT_TRUE(solver::same_bits(rest.solution->light->indirect, whole.solution->light->indirect))
        << cut;
    resumed.insert(rest.solution->passes[rest.restored_pass].name);
  }
  for (const char* name : {"direct", "trace", "refine", "round"})
    EXPECT_TRUE(resumed.contains(name)) << name << " was never cut";
}

TEST_F(Parts, WhatIsDamagedIsComputedAgain) {
  const Attempt whole = run(kAll);
  const auto damage = [&](const char* name) {
    std::fstream file(folder_.path() / name, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(200);
    file.put('\x55');
  };
  struct Case {
    const char* what;
    std::function<void()> harm;
    std::uint32_t parts;  ///< of three that are left
  };
  for (const Case& c : std::vector<Case>{
           {"none", [] {}, 3},
           {"the last", [&] { damage("part_2.bin"); }, 2},
           {"the first", [&] { damage("part_0.bin"); }, 0},
           {"one is gone", [&] { std::filesystem::remove(folder_.path() / "part_1.bin"); }, 1},
           {"one is cut", [&] { std::filesystem::resize_file(folder_.path() / "part_1.bin", 90); },
            1}}) {
    remove_checkpoints(folder_.path());
    const Attempt first = run(3);
    c.harm();
    const Attempt rest = run(0);
    ASSERT_TRUE(rest.solution) << c.what;
    EXPECT_EQ(rest.restored.texels, c.parts > 0 ? first.ends.at(c.parts - 1) : 0) << c.what;
    EXPECT_TRUE(solver::same_bits(rest.solution->light->direct, whole.solution->light->direct))
        << c.what;
  }
}

TEST_F(Parts, OfAnotherBakeOrPassAreNotRead) {
  const Attempt first = run(3);
  const auto fresh = solver();
  const lightmap::Lightmap before(texels(), fresh->state_planes());
  lightmap::Lightmap after = before;
  solver::PassPlan plan = fresh->next({})->plan();
  after.detach(plan.writes);
  const auto count = [&](const char* key) {
    return read_parts(folder_.path(), key, plan, before, after).count;
  };
  EXPECT_EQ(count("key"), 3u);
  EXPECT_EQ(count("other"), 0u);
  plan.index = 1;
  EXPECT_EQ(count("key"), 0u);
  plan.index = 0;
  plan.batch_texels = 768;
  EXPECT_EQ(count("key"), first.ends[0] % 768 ? 0u : 1u) << "parts end where batches end";
  plan.batch_texels = 256;
  plan.writes.set(std::size_t(lightmap::PlaneId::kSky));
  after.detach(plan.writes);
  EXPECT_EQ(count("key"), 0u) << "other planes";
}

}  // namespace
}  // namespace kiln::checkpoint
