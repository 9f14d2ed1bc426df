#include "baker/exec/thread_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <limits>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

namespace kiln::baker {
namespace {

using namespace std::chrono_literals;

TEST(ThreadPool, RunsEachBatchOnce) {
  ThreadPool pool(3);
  std::vector<std::atomic<int>> runs(1000);
  EXPECT_TRUE(pool.for_batches(1000, {}, [&](std::uint32_t b) { ++runs[b]; }));
  for (const auto& r : runs) EXPECT_EQ(r, 1);
}

TEST(ThreadPool, NothingToDoIsDone) {
  ThreadPool pool(1);
  EXPECT_TRUE(pool.for_batches(0, {}, [](std::uint32_t) { FAIL(); }));
}

TEST(ThreadPool, ExceptionOfABatchReachesTheCaller) {
  ThreadPool pool(2);
  const auto bad = [](std::uint32_t b) {
    if (b == 5) throw std::runtime_error("batch 5");
  };
  EXPECT_THROW(pool.for_batches(100, {}, bad), std::runtime_error);
  EXPECT_TRUE(pool.for_batches(10, {}, [](std::uint32_t) {})) << "the pool lives on";
}

TEST(ThreadPool, StopEndsTheWaitSoon) {
  ThreadPool pool(2);
  std::stop_source stop;
  std::atomic<int> runs{0};
  std::jthread canceller([&] {
    std::this_thread::sleep_for(50ms);
    stop.request_stop();
  });
  const auto start = std::chrono::steady_clock::now();
  const bool whole = pool.for_batches(1'000'000, stop.get_token(), [&](std::uint32_t) {
    ++runs;
    std::this_thread::sleep_for(5ms);
  });
  EXPECT_FALSE(whole);
  EXPECT_LT(std::chrono::steady_clock::now() - start, 1s);
  const int at_return = runs;
  std::this_thread::sleep_for(30ms);
  EXPECT_EQ(runs, at_return) << "no batch runs after the call has returned";
}

TEST(ThreadPool, StoppedBeforehandRunsNothing) {
  ThreadPool pool(1);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(pool.for_batches(3, stop.get_token(), [](std::uint32_t) { FAIL(); }));
}

// A job of a few batches that arrives while a long one runs is served in turns: it needs about
// twice the time that it would need alone, not the time of the long job.
TEST(ThreadPool, JobsTakeTurns) {
  ThreadPool pool(1);
  std::atomic<int> long_done{0};
  std::atomic<bool> long_started{false};
  std::jthread long_job([&] {
    pool.for_batches(200, {}, [&](std::uint32_t) {
      long_started = true;
      std::this_thread::sleep_for(2ms);
      ++long_done;
    });
  });
  while (!long_started) std::this_thread::sleep_for(1ms);
  const int before = long_done;
  pool.for_batches(20, {}, [](std::uint32_t) { std::this_thread::sleep_for(2ms); });
  const int meanwhile = long_done - before;
  EXPECT_GE(meanwhile, 15);
  EXPECT_LE(meanwhile, 25);
}

TEST(ThreadPool, DenormalsAreFlushed) {
  ThreadPool pool(1);
  volatile float tiny = std::numeric_limits<float>::min();
  float half = 1;
  pool.for_batches(1, {}, [&](std::uint32_t) { half = tiny / 2; });
  EXPECT_EQ(half, 0.f);
}

}  // namespace
}  // namespace kiln::baker
