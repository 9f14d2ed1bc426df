#include "server/jobs/job_watches.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "tests/server/job_service_fixture.h"

namespace kiln::jobs {
namespace {

TEST(JobWatches, TellThoseWhomItConcernsAndOnce) {
  JobWatches watches;
  int end = 0, later = 0, other = 0;
  const auto a = watches.add("job_a", std::nullopt, [&] { ++end; });
  const auto b = watches.add("job_a", 7, [&] { ++later; });
  const auto c = watches.add("job_b", 1, [&] { ++other; });
  watches.tell("job_a", 7, false);
  EXPECT_EQ(later, 0) << "that version is known";
  watches.tell("job_a", 8, false);
  EXPECT_EQ(later, 1);
  EXPECT_EQ(end, 0);
  watches.tell("job_a", 9, true);
  EXPECT_EQ(later, 1);
  EXPECT_EQ(end, 1);
  watches.tell("job_a", 10, true);
  EXPECT_EQ(end, 1);
  EXPECT_EQ(other, 0);
}

TEST(JobWatches, EndWithTheirHandleWhichMayComeLast) {
  JobWatches::Watch kept;
  int calls = 0;
  {
    JobWatches watches;
    {
      const auto ended = watches.add("job_a", std::nullopt, [&] { ++calls; });
    }
    watches.tell("job_a", 1, true);
    EXPECT_EQ(calls, 0);
    kept = watches.add("job_a", std::nullopt, [&] { ++calls; });
  }
  kept.reset();
  EXPECT_EQ(calls, 0);
}

// What a race detector should see, above all.
TEST(JobWatches, MayBeAddedAndEndedWhileOthersTell) {
  JobWatches watches;
  std::atomic<bool> done{false};
  std::atomic<int> calls{0};
  std::thread teller([&] {
    while (!done) {
      watches.tell("job_a", 2, false);
      std::this_thread::yield();
    }
  });
  for (int i = 0; i < 200; ++i) {
    const auto called = std::make_shared<std::atomic<bool>>(false);
    const auto ended = watches.add("job_a", 1, [&] { ++calls; });
    const auto kept = watches.add("job_a", 1, [called] { *called = true; });
    while (!*called) std::this_thread::yield();
  }
  done = true;
  teller.join();
  EXPECT_LE(calls, 200);
  const int before = calls;
  watches.tell("job_a", 2, true);
  EXPECT_EQ(calls, before) << "those that have ended hear nothing";
}

class WatchedJob : public JobServiceTest {};

TEST_F(WatchedJob, IsToldOfAtOnceWhenItHasMovedAlready) {
  start(fake_.instant());
  const std::string id = submit();
  wait(id);
  int calls = 0;
  const auto over = lookup().watch(id, std::nullopt, [&] { ++calls; });
  const auto none = lookup().watch("job_none", std::nullopt, [&] { ++calls; });
  EXPECT_EQ(calls, 2);
}

// A change between the look at a job and the watch for the next one must not be slept through.
TEST_F(WatchedJob, LosesNoChange) {
  JobLimits none_runs;
  none_runs.running = 0;
  start(fake_.instant(), none_runs);
  const std::string id = submit();
  constexpr int kChanges = 200;
  const std::uint64_t last = lookup().get(id)->version + kChanges;
  std::jthread changer([&] {
    for (int i = 0; i < kChanges; ++i) {
      proto::JobPatch patch;
      patch.labels["n"] = std::to_string(i);
      control().patch(id, patch, [](std::uint64_t) { return true; });
    }
  });
  for (std::uint64_t version = 0; version < last; version = lookup().get(id)->version) {
    const auto moved = std::make_shared<std::promise<void>>();
    const auto watch = lookup().watch(id, version, [moved] { moved->set_value(); });
    ASSERT_EQ(moved->get_future().wait_for(20s), std::future_status::ready) << version;
  }
}

}  // namespace
}  // namespace kiln::jobs
