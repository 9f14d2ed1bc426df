// Which passes count as finished, and when: once a checkpoint holds them, and not before.
#include "baker/checkpoint/writer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <numeric>

#include "baker/checkpoint/parts.h"
#include "baker/checkpoint/store.h"
#include "baker/solver/solver.h"
#include "tests/support/temp_files.h"

namespace kiln::checkpoint {
namespace {

constexpr std::uint32_t kTexels = 8;
constexpr double kNever = 1e-12;  ///< share: not before somebody waits

class EmptyPass final : public solver::Pass {
 public:
  using Pass::Pass;
  std::uint64_t run(atlas::TexelRange, const lightmap::Lightmap&,
                    const lightmap::LightmapView&) const override {
    return 0;
  }
};

/// A solver of as many passes as asked for; `filling` of them write the shared plane.
class Passes final : public solver::Solver {
 public:
  struct Filling {
    std::uint32_t first = 0, count = 0;
  };
  explicit Passes(Filling filling) : filling_(filling) {}
  static solver::PassPlan pass(std::uint32_t index, bool fills = false) {
    solver::PassPlan p;
    p.name = "p";
    p.index = index;
    p.writes = lightmap::plane_set({lightmap::PlaneId::kDirect});
    if (fills) p.writes |= lightmap::shared_planes();
    p.batch_texels = 1;
    return p;
  }
  std::vector<lightmap::PlaneSpec> state_planes() const override {
    return {{lightmap::PlaneId::kHits, 2}};
  }
  std::unique_ptr<solver::Pass> next(std::span<const proto::PassReport> done) const override {
    const auto index = std::uint32_t(done.size());
    return std::make_unique<EmptyPass>(pass(index, index - filling_.first < filling_.count));
  }
  solver::Forecast forecast() const override { return {100, solver::Work::other(1)}; }
  const solver::SamplePlan& samples() const override { return plan_; }

 private:
  Filling filling_;
  solver::SamplePlan plan_;
};

class Writing : public ::testing::Test {
 protected:
  test::TempFolder folder_;
  std::stop_source stop_;
  Passes::Filling filling_{0, 2};
  Passes solver_{filling_};
  std::vector<proto::PassReport> passes_;
  std::vector<std::uint32_t> told_;
  std::vector<std::size_t> on_disk_;  ///< passes that were, each time one was told
  std::vector<std::string> failures_;
  std::optional<CheckpointWriter> writer_;

  void start(double share) {
    CheckpointWriter::Options options;
    options.dir = folder_.path();
    options.key = "key";
    options.share = share;
    options.stop = stop_.get_token();
    writer_.emplace(
        options,
        CheckpointWriter::Listener{[this](const proto::PassReport& p) {
                                     told_.push_back(p.index);
                                     on_disk_.push_back(passes_on_disk());
                                   },
                                   [this](const proto::Error& e) { failures_.push_back(e.code); }},
        0);
  }
  std::size_t passes_on_disk() const {
    Passes fresh(filling_);
    const auto start = read_checkpoint(folder_.path(), "key", fresh, kTexels);
    return start && *start ? (*start)->passes.size() : 0;
  }
  void submit(bool fills = false) {
    proto::PassReport report;
    report.name = "p";
    report.index = std::uint32_t(passes_.size());
    const solver::PassPlan pass = Passes::pass(report.index, fills);
    writer_->begin_pass(pass);
    passes_.push_back(report);
    writer_->submit(pass, passes_, light_);
  }
  void submit_part(std::uint32_t texels, bool fills = false) {
    const solver::PassPlan pass = Passes::pass(std::uint32_t(passes_.size()), fills);
    writer_->begin_pass(pass);
    after_ = std::make_shared<lightmap::Lightmap>(*light_);
    after_->detach(pass.writes);
    writer_->submit_part(pass, after_, {texels, 10 * texels, 0.5});
  }
  /// Texels of the pass under way that the next process finds.
  std::uint32_t kept(bool fills = false) {
    const solver::PassPlan pass = Passes::pass(std::uint32_t(passes_.size()), fills);
    const lightmap::Lightmap before(kTexels, solver_.state_planes());
    lightmap::Lightmap after = before;
    after.detach(pass.writes);
    return read_parts(folder_.path(), "key", pass, before, after).progress.texels;
  }
  const std::shared_ptr<lightmap::Lightmap> light_ =
      std::make_shared<lightmap::Lightmap>(kTexels, solver_.state_planes());
  std::shared_ptr<lightmap::Lightmap> after_;
  static std::vector<std::uint32_t> first(std::uint32_t n) {
    std::vector<std::uint32_t> all(n);
    std::iota(all.begin(), all.end(), 0u);
    return all;
  }
};

TEST_F(Writing, ShortPassesShareACheckpointAndAreToldInOrder) {
  start(kNever);
  submit(true), submit(true);
  for (int i = 0; i < 5; ++i) submit();
  EXPECT_EQ(passes_on_disk(), 0u);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(7));
  EXPECT_EQ(on_disk_, std::vector<std::size_t>(7, 7)) << "a pass was told before it was durable";
}

TEST_F(Writing, EachPassHasItsOwnWhenTheyMayTakeAllTheTime) {
  start(1);
  submit(true), submit(true), submit(), submit();
  EXPECT_EQ(told_, first(4)) << "submit() waits";
  EXPECT_EQ(on_disk_, (std::vector<std::size_t>{1, 2, 3, 4}));
}

TEST_F(Writing, APassIsWrittenWhileTheNextOneRuns) {
  start(0.5);
  submit(true), submit(true), submit();
  const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (passes_on_disk() < 3 && std::chrono::steady_clock::now() < late)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(passes_on_disk(), 3u);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(3));
}

// As a gather does: direct light leaves no hits, then a long pass does. What the first
// left must be written without it, or there is nothing that parts of the second could follow.
TEST_F(Writing, APassThatFillsNoSharedPlaneIsWrittenWithoutWaitingForIt) {
  filling_ = {1, 1};
  start(kNever);
  submit();
  submit_part(4, true);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(passes_on_disk(), 1u);
  EXPECT_EQ(kept(true), 4u);
}

TEST_F(Writing, SharedPlanesThatAPassWillChangeAreNotReadAnyMore) {
  start(kNever);
  submit(true);
  writer_->begin_pass(Passes::pass(1, true));
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(passes_on_disk(), 0u) << "what waited with shared planes was dropped";
  submit(true);
  std::fill_n(light_->hits.data(), 2 * kTexels, lightmap::kFirstMiss + 1);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(2));
  const auto start = read_checkpoint(folder_.path(), "key", Passes(filling_), kTexels);
  ASSERT_TRUE(start && *start);
  EXPECT_EQ((*start)->light->hits.of(kTexels - 1)[1], lightmap::kFirstMiss + 1);
}

TEST_F(Writing, APassUnderWayIsKeptInParts) {
  start(1);
  submit_part(2, true), submit_part(5, true), submit_part(6, true);
  EXPECT_EQ(kept(true), 6u);
  writer_->end_parts();
  submit(true);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "part_0.bin")) << "its pass is done";
  submit_part(1, true);
  EXPECT_EQ(kept(true), 1u);
  EXPECT_EQ(told_, first(1));
}

TEST_F(Writing, WhatComesBeforeAPartIsWrittenBeforeIt) {
  start(kNever);
  submit(true), submit(true), submit();
  submit_part(4);
  writer_->flush();
  EXPECT_EQ(told_, first(3));
  EXPECT_EQ(kept(), 4u);
}

TEST_F(Writing, APartWithoutTheLightBeforeItIsNotWritten) {
  start(kNever);
  submit(true);          // waits with its state,
  submit_part(4, true);  // which this pass changes
  writer_->flush();
  EXPECT_EQ(passes_on_disk(), 0u);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "part_0.bin"));
}

TEST_F(Writing, APartIsNotReadOnceItsPassGoesOn) {
  start(kNever);
  submit_part(4, true);
  writer_->end_parts();
  EXPECT_EQ(after_.use_count(), 1);
  writer_->flush();
  EXPECT_EQ(kept(true), 0u);
}

TEST_F(Writing, NothingIsToldAfterAStop) {
  start(kNever);
  submit(true), submit(true);
  stop_.request_stop();
  EXPECT_FALSE(writer_->flush());
  writer_.reset();
  EXPECT_TRUE(told_.empty());
  EXPECT_EQ(passes_on_disk(), 0u);
}

TEST_F(Writing, AFolderThatIsGoneIsToldOnceAndThePassesCount) {
  start(kNever);
  submit(true), submit(true);
  std::filesystem::remove_all(folder_.path());
  EXPECT_TRUE(writer_->flush());
  submit(), submit();
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(4));
  EXPECT_EQ(failures_.size(), 1u);
}

TEST_F(Writing, WhatTheListenerThrowsReachesTheBake) {
  CheckpointWriter::Options options;
  options.dir = folder_.path();
  options.key = "key";
  writer_.emplace(
      options,
      CheckpointWriter::Listener{[](const proto::PassReport&) { throw std::bad_alloc(); }, {}}, 0);
  submit(true), submit(true);
  EXPECT_THROW(writer_->flush(), std::bad_alloc);
}

}  // namespace
}  // namespace kiln::checkpoint
