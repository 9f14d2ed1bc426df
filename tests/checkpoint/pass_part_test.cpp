// A bake that was cut in the middle of a pass computes no batch of it twice that was kept.
#include "baker/checkpoint/pass_part.h"

#include <gtest/gtest.h>

#include <climits>
#include <fstream>
#include <functional>
#include <mutex>
#include <set>

#include "baker/checkpoint/checkpoint.h"
#include "baker/solver/gather/gather.h"
#include "tests/support/quad_scene.h"
#include "tests/support/temp_files.h"

namespace kiln::checkpoint {
namespace {

/// Notes which texels another solver computes.
class Counted final : public solver::Solver {
 public:
  explicit Counted(std::unique_ptr<solver::Solver> solver) : solver_(std::move(solver)) {}
  /// (pass, first texel) of the batches
  std::set<std::pair<std::uint32_t, std::uint32_t>> ran;

  std::optional<solver::Pass> next(std::span<const proto::PassReport> done) const override {
    return solver_->next(done);
  }
  std::uint32_t max_passes() const override { return solver_->max_passes(); }
  solver::Work total_work() const override { return solver_->total_work(); }
  bool begin(const solver::Pass& p, const lightmap::Lightmap& before, lightmap::Lightmap& after,
             const exec::Workers& w) override {
    return solver_->begin(p, before, after, w);
  }
  std::uint64_t run(const solver::Pass& p, const lightmap::Lightmap& before,
                    atlas::TexelRange range, lightmap::Lightmap& after) override {
    {
      const std::lock_guard lock(mutex_);
      EXPECT_TRUE(ran.emplace(p.index, range.begin).second) << "twice in one attempt";
    }
    return solver_->run(p, before, range, after);
  }
  bool finish(const solver::Pass& p, lightmap::Lightmap& after, const exec::Workers& w,
              proto::PassReport& r) override {
    return solver_->finish(p, after, w, r);
  }
  std::span<std::byte> state() override { return solver_->state(); }
  std::optional<denoise::FilteredLight> filtered(const lightmap::Lightmap& l,
                                                 const exec::Workers& w) override {
    return solver_->filtered(l, w);
  }

 private:
  std::unique_ptr<solver::Solver> solver_;
  std::mutex mutex_;
};

class Parts : public ::testing::Test {
 protected:
  solver::QuadScene room_{96};
  std::optional<trace::RayScene> rays_;
  std::optional<light::LightSet> lights_;
  std::optional<trace::TexelLookup> lookup_;
  std::optional<solver::SolverInput> input_;
  test::TempFolder folder_;
  exec::ThreadPool pool_{2};

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
    input_.emplace(solver::SolverInput{room_.scene(), room_.atlas(), room_.texels(), *rays_,
                                       *lights_, *lookup_, settings});
  }
  std::uint32_t texels() const { return room_.texels().size(); }
  /// 64 of the 128 directions are remembered, so that a round follows.
  std::unique_ptr<Counted> solver() const {
    return std::make_unique<Counted>(
        solver::gather::make_gather_solver(*input_, 4ull * 64 * texels()));
  }

  struct Attempt {
    std::unique_ptr<Counted> solver;
    proto::Expected<solver::Solution> solution;
    solver::PassProgress restored;
    std::uint32_t restored_pass = 0;
    int parts = 0;
    solver::PassProgress last;  ///< of the part that was kept last
    std::uint32_t last_pass = 0;
  };
  static constexpr int kAll = INT_MAX;
  /// Goes on from the folder, with a part behind each batch, and stops after so many. 0: without.
  Attempt run(int parts) {
    Attempt a{solver(), proto::fail("x", "y"), {}, 0, 0, {}, 0};
    auto start = read_checkpoint(folder_.path(), "key", *a.solver, texels());
    EXPECT_TRUE(start);
    std::vector<proto::PassReport> passes;
    if (*start) passes = (*start)->passes;
    const auto known = passes.size();
    std::stop_source stop;
    std::uint32_t number = 0;
    solver::PassProgress kept;
    solver::SolveHooks hooks;
    hooks.part_time = std::chrono::seconds(parts > 0 ? 0 : 1000);
    hooks.restore = [&](const solver::Pass& pass, const lightmap::Lightmap& before,
                        lightmap::Lightmap& after) {
      number = 0, kept = {};
      if (pass.index != known) return kept;
      const auto stored = read_parts(folder_.path(), "key", pass, before, after, a.solver->state());
      number = stored.count;
      a.restored_pass = pass.index;
      return kept = a.restored = stored.progress;
    };
    hooks.on_part = [&](const solver::Pass& pass, std::shared_ptr<const lightmap::Lightmap> before,
                        std::shared_ptr<const lightmap::Lightmap> after,
                        const solver::PassProgress& now) {
      const PassPart part{pass.index,
                          number++,
                          {kept.texels, now.texels},
                          now.rays - kept.rays,
                          now.seconds - kept.seconds};
      const auto state = pass.fills_state ? a.solver->state() : std::span<std::byte>{};
      EXPECT_TRUE(write_part(folder_.path(), "key", part, *before, *after, state));
      kept = a.last = now;
      a.last_pass = pass.index;
      if (++a.parts == parts) stop.request_stop();
    };
    hooks.on_pass = [&](const solver::Pass& pass, const proto::PassReport& report,
                        std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
      passes.push_back(report);
      if (pass.fills_state && !pass.completes) {
        EXPECT_TRUE(write_state(folder_.path(), "key", a.solver->state()));
      }
      EXPECT_TRUE(write_checkpoint(folder_.path(), "key", passes, *light));
      return {};
    };
    a.solution = solve(*a.solver, room_.texels(), pool_, stop.get_token(), hooks,
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
    EXPECT_EQ(rest.restored.texels, c.parts * 256) << c.what;
    EXPECT_TRUE(solver::same_bits(rest.solution->light->direct, whole.solution->light->direct))
        << c.what;
  }
}

TEST_F(Parts, OfAnotherBakeOrPassAreNotRead) {
  run(3);
  const auto fresh = solver();
  const lightmap::Lightmap before(texels());
  lightmap::Lightmap after = before;
  solver::Pass pass = *fresh->next({});
  ASSERT_TRUE(fresh->begin(pass, before, after, {pool_, {}}));
  const auto count = [&](const char* key) {
    return read_parts(folder_.path(), key, pass, before, after, {}).count;
  };
  EXPECT_EQ(count("key"), 3u);
  EXPECT_EQ(count("other"), 0u);
  pass.index = 1;
  EXPECT_EQ(count("key"), 0u);
  pass.index = 0;
  pass.batch_texels = 512;
  EXPECT_EQ(count("key"), 0u) << "parts end where batches end";
  after.sky.own();
  pass.batch_texels = 256;
  EXPECT_EQ(count("key"), 0u) << "other planes";
}

}  // namespace
}  // namespace kiln::checkpoint
