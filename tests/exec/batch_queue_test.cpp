// What every queue of batches has to do. A new backend adds itself to the list at the end.
#include "baker/exec/batch_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "tests/support/patch_queue.h"
#include "tests/support/sanitizer.h"

namespace kiln::exec {
namespace {

using namespace std::chrono_literals;

/// Counts how often each batch has come in, by either way.
class Counting : public BatchWork {
 public:
  explicit Counting(std::uint32_t count) : times(count) {}
  std::vector<std::atomic<int>> times;
  std::function<void(std::uint32_t)> each;

  void run(std::uint32_t batch) override {
    if (each) each(batch);
    ++times.at(batch);
  }
  std::string compute(std::uint32_t batch) override {
    if (each) each(batch);
    return std::to_string(batch);
  }
  proto::Expected<void> take(std::uint32_t batch, std::string_view bytes) override {
    if (bytes != std::to_string(batch)) return proto::fail("invalid_patch", "of another batch");
    ++times.at(batch);
    return {};
  }
  std::vector<std::uint32_t> all() const {
    std::vector<std::uint32_t> batches(times.size());
    std::iota(batches.begin(), batches.end(), 0u);
    return batches;
  }
};

struct Backend {
  const char* name;
  std::unique_ptr<BatchQueue> (*make)(ThreadPool&);
};

class EveryQueue : public testing::TestWithParam<Backend> {
 protected:
  ThreadPool pool_{2};
  std::unique_ptr<BatchQueue> queue() { return GetParam().make(pool_); }
};

TEST_P(EveryQueue, RunsEachBatchOnceAndReportsIt) {
  Counting work(100);
  std::vector<std::uint32_t> some;
  for (const std::uint32_t b : work.all())
    if (b % 3 != 0) some.push_back(b);
  std::mutex mutex;
  std::vector<int> done(100);
  const auto ran = queue()->run(some, work,
                                [&](std::uint32_t batch) {
                                  const std::lock_guard lock(mutex);
                                  EXPECT_EQ(work.times[batch], 1) << "reported before it was there";
                                  ++done[batch];
                                },
                                {});
  ASSERT_TRUE(ran);
  for (const std::uint32_t b : work.all()) {
    EXPECT_EQ(work.times[b], b % 3 != 0) << b;
    EXPECT_EQ(done[b], b % 3 != 0) << b;
  }
  EXPECT_TRUE(queue()->run({}, work, {}, {})) << "no batches are done at once";
}

TEST_P(EveryQueue, JobsTakeTurns) {
  Counting large(400), small(10);
  std::atomic<bool> large_runs{false}, small_is_done{false};
  std::atomic<std::uint32_t> large_ran{0};
  large.each = [&](std::uint32_t) {
    large_runs = true;
    if (!small_is_done) ++large_ran;
    std::this_thread::sleep_for(1ms);
  };
  const auto first = queue(), second = queue();
  std::jthread other([&] { EXPECT_TRUE(first->run(large.all(), large, {}, {})); });
  while (!large_runs) std::this_thread::yield();
  EXPECT_TRUE(second->run(small.all(), small, {}, {}));
  small_is_done = true;
  EXPECT_LT(large_ran, 300u) << "ten batches need not wait for four hundred";
}

TEST_P(EveryQueue, StopsWithinASecond) {
  Counting work(100000);
  std::stop_source stop;
  std::chrono::steady_clock::time_point asked;
  work.each = [](std::uint32_t) { std::this_thread::sleep_for(5ms); };
  std::jthread canceler([&] {
    std::this_thread::sleep_for(50ms);
    asked = std::chrono::steady_clock::now();
    stop.request_stop();
  });
  const auto ran = queue()->run(work.all(), work, {}, stop.get_token());
  ASSERT_FALSE(ran);
  EXPECT_EQ(ran.error().code, proto::kCanceledCode);
  EXPECT_LT(std::chrono::steady_clock::now() - asked, 1s * test::kSlowdown);
  Counting none(10);
  EXPECT_FALSE(queue()->run(none.all(), none, {}, stop.get_token()));
  for (const auto& times : none.times) EXPECT_EQ(times, 0);
}

TEST_P(EveryQueue, ThrowsWhatABatchThrows) {
  Counting work(50);
  work.each = [](std::uint32_t batch) {
    if (batch == 7) throw std::runtime_error("a bug");
  };
  const auto batches = work.all();
  EXPECT_THROW((void)queue()->run(batches, work, {}, {}), std::runtime_error);
}

/// Work whose results are refused, as those of a machine that has gone mad.
class Refusing final : public Counting {
 public:
  using Counting::Counting;
  proto::Expected<void> take(std::uint32_t batch, std::string_view) override {
    if (batch == 3) return proto::fail("invalid_patch", "refused");
    ++times.at(batch);
    return {};
  }
};

TEST_P(EveryQueue, ReturnsTheErrorOfAResultThatIsRefused) {
  Refusing work(20);
  const auto ran = queue()->run(work.all(), work, {}, {});
  // A queue that runs everything in place takes in no results.
  if (ran) {
    for (const auto& times : work.times) EXPECT_EQ(times, 1);
  } else {
    EXPECT_EQ(ran.error().code, "invalid_patch");
    EXPECT_EQ(work.times[3], 0);
  }
}

INSTANTIATE_TEST_SUITE_P(
    , EveryQueue,
    testing::Values(Backend{"Local",
                            [](ThreadPool& pool) -> std::unique_ptr<BatchQueue> {
                              return std::make_unique<LocalQueue>(pool);
                            }},
                    Backend{"Patches",
                            [](ThreadPool& pool) -> std::unique_ptr<BatchQueue> {
                              return std::make_unique<test::PatchQueue>(pool, 7);
                            }}),
    [](const auto& backend) { return backend.param.name; });

}  // namespace
}  // namespace kiln::exec
