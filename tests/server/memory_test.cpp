#include <algorithm>
#include <fstream>

#include "server/base/machine.h"
#include "tests/server/job_service_fixture.h"

/// Admission by estimate: what runs together fits the machine.
namespace kiln::jobs {
namespace {

class Memory : public jobs::JobServiceTest {
 protected:
  static jobs::JobLimits limits(std::uint64_t bytes, std::uint32_t running = 3) {
    jobs::JobLimits limits;
    limits.running = running;
    limits.memory_bytes = bytes;
    return limits;
  }
  std::string submit_sized(std::uint32_t bytes) {
    jobs::Submission s = submission();
    s.settings.solver.seed = bytes;
    return submitter().submit(s).value().job.id;
  }
  std::size_t count(const std::string& id, const std::string& code) {
    const auto all = events(id);
    return static_cast<std::size_t>(std::count_if(all.begin(), all.end(), [&](const auto& e) {
      return e.data.find("\"" + code + "\"") != std::string::npos;
    }));
  }
};

TEST_F(Memory, AJobOverTheBudgetFails) {
  start(fake_.sized(), limits(100));
  const proto::Job job = wait(submit_sized(101));
  EXPECT_EQ(job.state, proto::JobState::kFailed);
  EXPECT_EQ(job.error->code, "job_too_large");
  EXPECT_EQ(job.memory_estimate_bytes, 101u);
  const std::string fits = submit_sized(100);
  reach(fits, proto::JobState::kRunning);
  fake_.go = true;
  EXPECT_EQ(wait(fits).state, proto::JobState::kSucceeded);
  EXPECT_EQ(admission().counts().reserved_bytes, 0u);
}

TEST_F(Memory, WhatDoesNotFitWaitsInTheQueue) {
  start(fake_.sized(), limits(100));
  const std::string first = submit_sized(60);
  reach(first, proto::JobState::kRunning);
  const std::string large = submit_sized(70);
  for (int i = 0; i < 2000 && count(large, "waits_for_memory") == 0; ++i)
    std::this_thread::sleep_for(5ms);
  EXPECT_EQ(lookup().get(large)->state, proto::JobState::kQueued);
  EXPECT_EQ(lookup().get(large)->attempt, 1u);
  EXPECT_EQ(lookup().get(large)->memory_estimate_bytes, 70u);
  const std::string small = submit_sized(10);
  std::this_thread::sleep_for(100ms);
  EXPECT_EQ(lookup().get(small)->state, proto::JobState::kQueued) << "behind the one that waits";
  EXPECT_EQ(fake_.imported, 2) << "what waits is not imported again and again";
  EXPECT_EQ(admission().counts().reserved_bytes, 60u);
  EXPECT_TRUE(control().cancel(first));
  reach(large, proto::JobState::kRunning);
  reach(small, proto::JobState::kRunning);
  EXPECT_EQ(admission().counts().reserved_bytes, 80u);
  fake_.go = true;
  EXPECT_EQ(wait(large).state, proto::JobState::kSucceeded);
  EXPECT_EQ(wait(small).state, proto::JobState::kSucceeded);
  EXPECT_EQ(count(large, "waits_for_memory"), 1u);
  expect_no_holes(events(large));
}

TEST_F(Memory, WhatWaitsCanBeCanceledAndSurvivesTheProcess) {
  start(fake_.sized(), limits(100));
  const std::string running = submit_sized(90);
  reach(running, proto::JobState::kRunning);
  const std::string canceled = submit_sized(20), kept = submit_sized(30);
  for (int i = 0; i < 2000 && count(canceled, "waits_for_memory") == 0; ++i)
    std::this_thread::sleep_for(5ms);
  EXPECT_EQ(control().cancel(canceled)->state, proto::JobState::kCanceled);
  for (int i = 0; i < 2000 && count(kept, "waits_for_memory") == 0; ++i)
    std::this_thread::sleep_for(5ms);
  EXPECT_EQ(lookup().get(kept)->state, proto::JobState::kQueued);
  jobs().stop();
  fake_.go = true;
  // The budget of the next process is smaller: what was let in once is looked at again.
  start(fake_.sized(), limits(25));
  EXPECT_EQ(wait(kept).error->code, "job_too_large");
  EXPECT_EQ(wait(running).error->code, "job_too_large");
}

// Of 1000, 2 times 100 are set aside for imports.
JobLimits shared_limits() {
  jobs::JobLimits limits;
  limits.running = 3;
  limits.memory =
      std::make_shared<base::MemoryBudget>(1000, base::MemoryBudget::Imports{2, 600, 100});
  return limits;
}

TEST_F(Memory, AJobsImportDrawsOnItsReservation) {
  const jobs::JobLimits limits = shared_limits();
  const auto importing = [&limits, sized = fake_.sized()](
                             const jobs::JobInput& input, exec::ThreadPool& pool,
                             std::stop_token stop,
                             baker::BakeObserver& observer) -> proto::Expected<proto::Manifest> {
    {
      const auto place = limits.memory->enter(600, stop, 20s, input.job);
      if (!place) return proto::Unexpected(place.error());
    }
    return sized(input, pool, stop, observer);
  };
  start(importing, limits);
  const std::string first = submit_sized(300);
  reach(first, proto::JobState::kRunning);
  const std::string second = submit_sized(700);
  for (int i = 0; i < 2000 && count(second, "waits_for_memory") == 0; ++i)
    std::this_thread::sleep_for(5ms);
  EXPECT_TRUE(control().cancel(first));
  reach(second, proto::JobState::kRunning);  // with 700 and, for its import, 500 of 800
  fake_.go = true;
  EXPECT_EQ(wait(second).state, proto::JobState::kSucceeded);
}

TEST_F(Memory, AJobThatWaitsForAnImportIsLeftInPeace) {
  const jobs::JobLimits limits = shared_limits();
  start(fake_.sized(), limits);
  std::string id;
  {
    const auto check = limits.memory->enter(600, {}, 0ms);
    ASSERT_TRUE(check);
    id = submit_sized(400);
    for (int i = 0; i < 2000 && count(id, "waits_for_memory") == 0; ++i)
      std::this_thread::sleep_for(5ms);
    std::this_thread::sleep_for(100ms);
    EXPECT_EQ(lookup().get(id)->state, proto::JobState::kQueued);
    EXPECT_EQ(fake_.imported, 1) << "though no other job runs";
  }
  reach(id, proto::JobState::kRunning);
  EXPECT_EQ(fake_.imported, 2);
  EXPECT_EQ(count(id, "waits_for_memory"), 1u);
}

TEST(Machine, FreeMemoryIsWhatTheNarrowestLimitLeaves) {
  const test::TempFolder folder;
  const auto root = folder.path();
  const auto write = [&](const std::string& name, const std::string& text) {
    std::filesystem::create_directories((root / name).parent_path());
    std::ofstream(root / name) << text;
  };
  EXPECT_EQ(base::free_memory_bytes(root), 0u);
  write("proc/meminfo", "MemTotal: 9000 kB\nMemAvailable:    1000 kB\n");
  EXPECT_EQ(base::free_memory_bytes(root), 1'024'000u);
  write("proc/self/cgroup", "0::/a/b\n");
  write("sys/fs/cgroup/a/b/memory.max", "max\n");
  EXPECT_EQ(base::free_memory_bytes(root), 1'024'000u);
  write("sys/fs/cgroup/a/memory.max", "500000\n");
  write("sys/fs/cgroup/a/memory.current", "100000\n");
  EXPECT_EQ(base::free_memory_bytes(root), 400'000u);
  write("sys/fs/cgroup/memory.max", "300000\n");
  EXPECT_EQ(base::free_memory_bytes(root), 300'000u);
  write("sys/fs/cgroup/a/b/memory.max", "7\n");
  write("sys/fs/cgroup/a/b/memory.current", "9\n");
  EXPECT_EQ(base::free_memory_bytes(root), 0u);
  EXPECT_GT(base::free_memory_bytes(), 1u << 20);
}

}  // namespace
}  // namespace kiln::jobs
