#include "server/base/memory_budget.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

/// What bakes and import processes take of the machine together.
namespace kiln::base {
namespace {

using namespace std::chrono_literals;
using Imports = MemoryBudget::Imports;

constexpr auto kLong = 20s;  ///< beyond, something is stuck

void wait_until(const std::function<bool()>& there) {
  const auto deadline = std::chrono::steady_clock::now() + kLong;
  while (!there() && std::chrono::steady_clock::now() < deadline) std::this_thread::sleep_for(1ms);
  ASSERT_TRUE(there());
}

// Of 1000, 2 times 100 are set aside for imports.
struct Shared : testing::Test {
  MemoryBudget budget{1000, Imports{2, 600, 100}};

  std::uint64_t enter_now(std::uint64_t bytes) {
    const auto place = budget.enter(bytes, {}, 0ms);
    return place ? place->bytes() : 0;
  }
};

TEST_F(Shared, ALoanIsOfWhatBakesHaveLeft) {
  std::atomic<int> woken{0};
  budget.on_free([&] { ++woken; });
  ASSERT_TRUE(budget.reserve("a", 500));
  EXPECT_FALSE(budget.borrow(301));
  {
    const auto loan = budget.borrow(200);
    ASSERT_TRUE(loan);
    EXPECT_EQ(budget.free_bytes(), 100u);
    EXPECT_FALSE(budget.borrow(101));
    EXPECT_TRUE(budget.borrow(100)) << "several at a time";
    EXPECT_EQ(woken, 1);
    EXPECT_FALSE(budget.reserve("a", 601)) << "a bake cannot have what is lent";
  }
  EXPECT_EQ(woken, 2) << "bakes that wait are told";
  EXPECT_TRUE(budget.reserve("a", 800));
  MemoryBudget endless(0);
  EXPECT_TRUE(endless.borrow(UINT64_MAX / 2));
}

TEST_F(Shared, SomethingIsSetAsideForEachImport) {
  EXPECT_EQ(budget.for_bakes(), 800u);
  EXPECT_FALSE(budget.reserve("a", 801));
  EXPECT_TRUE(budget.reserve("a", 800));
  EXPECT_EQ(budget.free_bytes(), 0u);
  const auto first = budget.enter(1, {}, 0ms), second = budget.enter(100, {}, 0ms);
  ASSERT_TRUE(first && second) << "whatever bakes have";
  EXPECT_EQ(first->bytes(), 100u);
  EXPECT_EQ(budget.enter(1, {}, 0ms).error().code, "overloaded") << "two at once";
}

TEST_F(Shared, WhatAnImportNeedsBeyondIsWhatBakesLeft) {
  EXPECT_TRUE(budget.reserve("a", 500));
  {
    const auto place = budget.enter(400, {}, 0ms);
    ASSERT_TRUE(place);
    EXPECT_EQ(budget.free_bytes(), 0u);
    EXPECT_FALSE(budget.reserve("b", 1));
    EXPECT_EQ(enter_now(101), 0u);
    EXPECT_EQ(enter_now(100), 100u);
  }
  EXPECT_EQ(budget.free_bytes(), 300u);
  EXPECT_TRUE(budget.reserve("b", 300));
  EXPECT_TRUE(budget.reserve("a", 400)) << "less than before";
  budget.release("a");
  EXPECT_EQ(budget.reserved(), 300u);
  EXPECT_EQ(budget.for_import(), 600u);
  EXPECT_EQ(enter_now(5000), 600u) << "no more than the limit";
}

TEST_F(Shared, BakesDoNotPassAnImportThatWaits) {
  EXPECT_TRUE(budget.reserve("a", 700));
  std::atomic<bool> in{false}, freed{false};
  budget.on_free([&] { freed = true; });
  std::jthread reader([&] {
    const auto place = budget.enter(600, {}, kLong);
    in = place.has_value();
  });
  wait_until([&] { return budget.free_bytes() == 0; });
  EXPECT_FALSE(budget.reserve("b", 10)) << "100 are free, and wanted";
  EXPECT_TRUE(budget.reserve("a", 650)) << "who is in may give back";
  budget.release("a");
  reader.join();
  EXPECT_TRUE(in);
  EXPECT_TRUE(freed) << "runners are told";
  EXPECT_TRUE(budget.reserve("b", 800));
}

TEST_F(Shared, WaitingEndsWithTheStop) {
  EXPECT_TRUE(budget.reserve("a", 800));
  std::stop_source stop;
  std::jthread later([&] {
    std::this_thread::sleep_for(20ms);
    stop.request_stop();
  });
  EXPECT_EQ(budget.enter(200, stop.get_token()).error().code, "canceled");
  budget.release("a");
  EXPECT_EQ(budget.free_bytes(), 800u) << "nothing is wanted any more";
}

TEST_F(Shared, WorkForAJobDrawsOnWhatItReserved) {
  EXPECT_TRUE(budget.reserve("a", 700));
  {
    const auto place = budget.enter(600, {}, 0ms, "a");
    ASSERT_TRUE(place) << "700 or 500 beyond, not 1200";
    EXPECT_EQ(place->bytes(), 600u);
    EXPECT_EQ(budget.free_bytes(), 100u);
    EXPECT_TRUE(budget.imports_are_modest());
    EXPECT_FALSE(budget.enter(600, {}, 0ms)) << "another";
  }
  EXPECT_TRUE(budget.reserve("a", 200));
  {
    const auto place = budget.enter(600, {}, 0ms, "a");
    ASSERT_TRUE(place);
    EXPECT_EQ(budget.reserved("a"), 200u);
    EXPECT_EQ(budget.free_bytes(), 300u) << "500 are taken";
    EXPECT_FALSE(budget.imports_are_modest());
  }
  EXPECT_EQ(budget.free_bytes(), 600u);
}

TEST_F(Shared, JobsThatWaitDoNotBlockEachOther) {
  EXPECT_TRUE(budget.reserve("a", 400));
  EXPECT_TRUE(budget.reserve("b", 400));
  std::atomic<int> in{0};
  std::vector<std::jthread> both;
  for (const char* job : {"a", "b"})
    both.emplace_back([&, job] {
      {
        const auto place = budget.enter(600, {}, kLong, job);
        if (place && budget.reserved(job) == 400) ++in;
      }
      budget.release(job);  // its bake is over
    });
  both.clear();
  EXPECT_EQ(in, 2) << "each lets go of its 400 while it waits for 500";
  EXPECT_EQ(budget.free_bytes(), 800u);
}

TEST_F(Shared, WhoWaitsForMemoryIsServedInTurn) {
  EXPECT_TRUE(budget.reserve("a", 700));
  std::mutex mutex;
  std::vector<std::uint64_t> order;
  std::vector<std::jthread> threads;
  for (const std::uint64_t bytes : {600u, 150u}) {
    threads.emplace_back([&, bytes] {
      const auto place = budget.enter(bytes, {}, kLong);
      const std::lock_guard lock(mutex);
      order.push_back(place ? bytes : 0);
    });
    if (bytes == 600) wait_until([&] { return budget.free_bytes() == 0; });
  }
  std::this_thread::sleep_for(50ms);
  EXPECT_TRUE(order.empty()) << "100 are free, but another was there before";
  EXPECT_EQ(enter_now(100), 100u) << "what is set aside is for all";
  budget.release("a");
  threads.clear();
  EXPECT_EQ(order.size(), 2u);
  EXPECT_EQ(std::ranges::count(order, 0u), 0);
}

TEST(MemoryBudget, SmallMachinesKeepThreeQuartersForBakes) {
  const MemoryBudget small(400, {4, 1000, 100, 10});
  EXPECT_EQ(small.for_bakes(), 300u);
  EXPECT_EQ(small.for_import(), 325u);
  MemoryBudget none(0, {1, 50, 100});
  EXPECT_TRUE(none.reserve("a", UINT64_MAX));
  EXPECT_EQ(none.enter(7, {}, 0ms)->bytes(), 50u);
}

TEST(MemoryBudget, ThereAreFewerPlacesWhereEachWouldBeOfNoUse) {
  constexpr std::uint64_t kMiB = 1 << 20;
  const MemoryBudget many(1024 * kMiB, {256, 4096 * kMiB});
  EXPECT_EQ(many.processes(), 4u);
  EXPECT_EQ(many.for_bakes(), 768 * kMiB);
  MemoryBudget small(200 * kMiB, {4, 4096 * kMiB});
  EXPECT_EQ(small.processes(), 1u);
  EXPECT_EQ(small.enter(1, {}, 0ms)->bytes(), 64 * kMiB);
  EXPECT_EQ(small.for_bakes(), 136 * kMiB);
  EXPECT_EQ(MemoryBudget(100, {4, 1000}).for_bakes(), 50u);
  EXPECT_EQ(MemoryBudget(8192 * kMiB, {4, 4096 * kMiB}).for_bakes(), 7168 * kMiB);
}

TEST(MemoryBudget, FewMayWaitWithPatience) {
  MemoryBudget budget(1000, {1, 600, 100, 1, 1});
  std::optional<MemoryBudget::Place> place = budget.enter(1, {}, 0ms).value();
  std::atomic<bool> in{false};
  std::jthread first([&] { in = budget.enter(600, {}, kLong).has_value(); });
  wait_until([&] { return budget.free_bytes() == 400; });
  const auto before = std::chrono::steady_clock::now();
  EXPECT_EQ(budget.enter(1, {}, 2 * kLong).error().code, "overloaded");
  EXPECT_LT(std::chrono::steady_clock::now() - before, kLong) << "at once";
  place.reset();
  first.join();
  EXPECT_TRUE(in);
  EXPECT_TRUE(budget.enter(1, {}, kLong)) << "who need not wait, may come";
}

TEST(MemoryBudget, WakesOneWatchForEachProcessThatEnds) {
  MemoryBudget budget(1000, {2, 600, 100});
  std::string woken;
  const auto watch = [&](char name) { return budget.watch([&woken, name] { woken += name; }); };
  const auto a = watch('a');
  auto b = watch('b');
  const auto c = watch('c'), d = watch('d');
  b.reset();
  for (const char* expected : {"a", "ac", "acd", "acd"}) {
    ASSERT_TRUE(budget.enter(1, {}, 0ms));  // and out again
    EXPECT_EQ(woken, expected);
  }
}

TEST(MemoryBudget, IsNeverExceeded) {
  MemoryBudget budget(1000, {3, 500, 50});
  std::atomic<std::int64_t> taken{0}, most{0}, processes{0};
  std::vector<std::jthread> threads;
  for (int t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      for (std::uint64_t i = 0; i < 300; ++i) {
        const std::uint64_t bytes = 1 + (i * 37 + std::uint64_t(t) * 101) % 400;
        const auto note = [&](std::int64_t more) {
          const std::int64_t now = taken += more;
          for (std::int64_t m = most; m < now && !most.compare_exchange_weak(m, now);) {
          }
        };
        if (t % 2 == 0) {
          const auto place = budget.enter(bytes, {});
          ASSERT_TRUE(place);
          EXPECT_LE(++processes, 3);
          note(std::int64_t(place->bytes()));
          note(-std::int64_t(place->bytes()));
          --processes;
        } else if (const std::string job = std::to_string(t); budget.reserve(job, bytes)) {
          note(std::int64_t(bytes));
          note(-std::int64_t(bytes));
          budget.release(job);
        }
      }
    });
  threads.clear();
  EXPECT_LE(most, 1000);
  EXPECT_EQ(budget.free_bytes(), 850u);
}

}  // namespace
}  // namespace kiln::base
