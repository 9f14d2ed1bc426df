#include "baker/exec/thread_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <bit>
#include <chrono>
#include <latch>
#include <limits>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

namespace kiln::exec {
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
  std::jthread canceler([&] {
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

/// What the calling thread makes of numbers below the normal ones.
struct Denormals {
  bool kept_as_result = false, kept_as_operand = false;
};
Denormals denormals() {
  volatile float normal = std::numeric_limits<float>::min();
  volatile float denormal = std::numeric_limits<float>::denorm_min();
  const float result = normal / 2, product = denormal * 0x1p60f;  // a normal number, if any
  // By bits: a comparison too may take a denormal operand for zero.
  return {std::bit_cast<std::uint32_t>(result) != 0, std::bit_cast<std::uint32_t>(product) != 0};
}

TEST(ThreadPool, DenormalsAreFlushedOnEveryThread) {
  constexpr unsigned kThreads = 5;
  ThreadPool pool(kThreads);
  std::vector<Denormals> found(kThreads, {true, true});
  std::latch all(kThreads);  // so that each thread takes one batch
  pool.for_batches(kThreads, {}, [&](std::uint32_t b) {
    all.arrive_and_wait();
    found[b] = denormals();
  });
  for (const Denormals& d : found) {
    EXPECT_FALSE(d.kept_as_result);
    EXPECT_FALSE(d.kept_as_operand);
  }
}

TEST(ThreadPool, DenormalsAreKeptElsewhere) {
  ThreadPool pool(2);
  pool.for_batches(8, {}, [](std::uint32_t) { denormals(); });
  const auto expect_kept = [](const Denormals& d) {
    EXPECT_TRUE(d.kept_as_result);
    EXPECT_TRUE(d.kept_as_operand);
  };
  expect_kept(denormals());
  std::thread([&] { expect_kept(denormals()); }).join();  // inherits its maker's state
}

// A request that comes between the first look and the wait once left both waiting for the mutex.
TEST(ThreadPool, AStopRequestMayComeAtAnyMomentOfACall) {
  ThreadPool pool(2);
  for (int i = 0; i < 20'000; ++i) {
    std::stop_source stop;
    const std::jthread asker([&] { stop.request_stop(); });
    while (pool.for_batches(2, stop.get_token(), [](std::uint32_t) {})) {
    }
  }
}

}  // namespace
}  // namespace kiln::exec
