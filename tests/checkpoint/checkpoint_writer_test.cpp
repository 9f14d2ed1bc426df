// Which passes count as finished, and when: once a checkpoint holds them, and not before.
#include "baker/checkpoint/checkpoint_writer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <numeric>

#include "baker/checkpoint/checkpoint.h"
#include "tests/support/temp_files.h"

namespace kiln::checkpoint {
namespace {

constexpr std::uint32_t kTexels = 8;
constexpr double kNever = 1e-12;  ///< share: not before somebody waits

/// A solver of as many passes as asked for; `filling` of them leave a state.
class Passes final : public solver::Solver {
 public:
  struct Filling {
    std::uint32_t first = 0, count = 0;
  };
  explicit Passes(Filling filling) : filling_(filling) {}
  static solver::Pass pass(std::uint32_t index, bool fills = false) {
    solver::Pass p;
    p.name = "p";
    p.index = index;
    p.fills_state = fills;
    p.batch_texels = 1;
    return p;
  }
  std::optional<solver::Pass> next(std::span<const proto::PassReport> done) const override {
    const auto index = std::uint32_t(done.size());
    return pass(index, index - filling_.first < filling_.count);
  }
  std::uint32_t max_passes() const override { return 100; }
  solver::Work total_work() const override { return solver::Work::other(1); }
  bool begin(const solver::Pass&, const lightmap::Lightmap&, lightmap::Lightmap&,
             const exec::Workers&) override {
    return true;
  }
  std::uint64_t run(const solver::Pass&, const lightmap::Lightmap&, atlas::TexelRange,
                    lightmap::Lightmap&) override {
    return 0;
  }
  std::span<std::byte> state() override { return state_; }
  std::optional<denoise::FilteredLight> filtered(const lightmap::Lightmap&,
                                                 const exec::Workers&) override {
    return {};
  }

 private:
  Filling filling_;
  std::vector<std::byte> state_ = std::vector<std::byte>(64);
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
  void offer(bool fills = false) {
    proto::PassReport report;
    report.name = "p";
    report.index = std::uint32_t(passes_.size());
    const solver::Pass pass = Passes::pass(report.index, fills);
    writer_->before(pass);
    passes_.push_back(report);
    writer_->offer(pass, passes_, std::make_shared<lightmap::Lightmap>(kTexels), solver_.state());
  }
  void offer_part(std::uint32_t texels, bool fills = false) {
    const solver::Pass pass = Passes::pass(std::uint32_t(passes_.size()), fills);
    writer_->before(pass);
    after_ = std::make_shared<lightmap::Lightmap>(*before_);
    after_->direct.own();
    writer_->offer_part(pass, before_, after_, {texels, 10 * texels, 0.5}, solver_.state());
  }
  /// Texels of the pass under way that the next process finds.
  std::uint32_t kept(bool fills = false) {
    Passes fresh(filling_);
    const solver::Pass pass = Passes::pass(std::uint32_t(passes_.size()), fills);
    lightmap::Lightmap after = *before_;
    after.direct.own();
    return read_parts(folder_.path(), "key", pass, *before_, after, fresh.state()).progress.texels;
  }
  const std::shared_ptr<const lightmap::Lightmap> before_ =
      std::make_shared<lightmap::Lightmap>(kTexels);
  std::shared_ptr<lightmap::Lightmap> after_;
  static std::vector<std::uint32_t> first(std::uint32_t n) {
    std::vector<std::uint32_t> all(n);
    std::iota(all.begin(), all.end(), 0u);
    return all;
  }
};

TEST_F(Writing, ShortPassesShareACheckpointAndAreToldInOrder) {
  start(kNever);
  offer(true), offer(true);
  for (int i = 0; i < 5; ++i) offer();
  EXPECT_EQ(passes_on_disk(), 0u);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(7));
  EXPECT_EQ(on_disk_, std::vector<std::size_t>(7, 7)) << "a pass was told before it was durable";
}

TEST_F(Writing, EachPassHasItsOwnWhenTheyMayTakeAllTheTime) {
  start(1);
  offer(true), offer(true), offer(), offer();
  EXPECT_EQ(told_, first(4)) << "offer() waits";
  EXPECT_EQ(on_disk_, (std::vector<std::size_t>{1, 2, 3, 4}));
}

TEST_F(Writing, APassIsWrittenWhileTheNextOneRuns) {
  start(0.5);
  offer(true), offer(true), offer();
  const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (passes_on_disk() < 3 && std::chrono::steady_clock::now() < late)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(passes_on_disk(), 3u);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(3));
}

// As a gather does: direct light leaves nothing, then a long pass fills the state. What the first
// left must be written without it, or there is nothing that parts of the second could follow.
TEST_F(Writing, APassThatFillsNoStateIsWrittenWithoutWaitingForIt) {
  filling_ = {1, 1};
  start(kNever);
  offer();
  offer_part(4, true);
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(passes_on_disk(), 1u);
  EXPECT_EQ(kept(true), 4u);
}

TEST_F(Writing, StateThatAPassWillChangeIsNotReadAnyMore) {
  start(kNever);
  offer(true);
  writer_->release_state();
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(passes_on_disk(), 0u) << "what waited for the state was dropped";
  offer(true);
  std::ranges::fill(solver_.state(), std::byte{7});
  EXPECT_TRUE(writer_->flush());
  EXPECT_EQ(told_, first(2));
  Passes fresh(filling_);
  ASSERT_TRUE(read_checkpoint(folder_.path(), "key", fresh, kTexels));
  EXPECT_EQ(fresh.state()[0], std::byte{7});
}

TEST_F(Writing, APassUnderWayIsKeptInParts) {
  start(1);
  offer_part(2, true), offer_part(5, true), offer_part(6, true);
  EXPECT_EQ(kept(true), 6u);
  writer_->release_part();
  offer(true);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "part_0.bin")) << "its pass is done";
  offer_part(1, true);
  EXPECT_EQ(kept(true), 1u);
  EXPECT_EQ(told_, first(1));
}

TEST_F(Writing, WhatComesBeforeAPartIsWrittenBeforeIt) {
  start(kNever);
  offer(true), offer(true), offer();
  offer_part(4);
  writer_->flush();
  EXPECT_EQ(told_, first(3));
  EXPECT_EQ(kept(), 4u);
}

TEST_F(Writing, APartWithoutTheLightBeforeItIsNotWritten) {
  start(kNever);
  offer(true);          // waits with its state,
  offer_part(4, true);  // which this pass changes
  writer_->flush();
  EXPECT_EQ(passes_on_disk(), 0u);
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "part_0.bin"));
}

TEST_F(Writing, APartIsNotReadOnceItsPassGoesOn) {
  start(kNever);
  offer_part(4, true);
  writer_->release_part();
  EXPECT_EQ(after_.use_count(), 1);
  writer_->flush();
  EXPECT_EQ(kept(true), 0u);
}

TEST_F(Writing, NothingIsToldAfterAStop) {
  start(kNever);
  offer(true), offer(true);
  stop_.request_stop();
  EXPECT_FALSE(writer_->flush());
  writer_.reset();
  EXPECT_TRUE(told_.empty());
  EXPECT_EQ(passes_on_disk(), 0u);
}

TEST_F(Writing, AFolderThatIsGoneIsToldOnceAndThePassesCount) {
  start(kNever);
  offer(true), offer(true);
  std::filesystem::remove_all(folder_.path());
  EXPECT_TRUE(writer_->flush());
  offer(), offer();
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
  offer(true), offer(true);
  EXPECT_THROW(writer_->flush(), std::bad_alloc);
}

}  // namespace
}  // namespace kiln::checkpoint
