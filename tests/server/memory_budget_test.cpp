#include "server/memory_budget.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

/// What bakes and import processes take of the machine together.
namespace kiln::server {
namespace {

using namespace std::chrono_literals;
using Imports = MemoryBudget::Imports;

// Of 1000, 2 times 100 are set aside for imports.
struct Shared : testing::Test {
  MemoryBudget budget{1000, Imports{2, 600, 100}};

  std::uint64_t enter_now(std::uint64_t bytes) {
    const auto place = budget.enter(bytes, {}, 0ms);
    return place ? place->bytes() : 0;
  }
};

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
    const auto place = budget.enter(600, {});
    in = place.has_value();
  });
  while (budget.free_bytes() > 0) std::this_thread::sleep_for(1ms);
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

TEST_F(Shared, WorkWithinAJobTakesAPlaceOnly) {
  EXPECT_TRUE(budget.reserve("a", 800));
  const auto lit = budget.enter_within_job({});
  ASSERT_TRUE(lit);
  EXPECT_EQ(lit->bytes(), 600u);
  EXPECT_EQ(enter_now(1), 100u);
}

TEST(MemoryBudget, SmallMachinesKeepThreeQuartersForBakes) {
  const MemoryBudget small(400, {4, 1000, 100});
  EXPECT_EQ(small.for_bakes(), 300u);
  EXPECT_EQ(small.for_import(), 325u);
  MemoryBudget none(0, {1, 50, 100});
  EXPECT_TRUE(none.reserve("a", UINT64_MAX));
  EXPECT_EQ(none.enter(7, {}, 0ms)->bytes(), 50u);
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
}  // namespace kiln::server
