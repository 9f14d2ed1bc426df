// Where more samples lower the error most for what they cost.
#include "baker/solver/adaptive/allocation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace kiln::solver {
namespace {

constexpr double kSlope = 0.65;

struct Spent {
  double variance = 0, cost = 0;
};

Spent spent(const std::vector<adaptive::AllocationUnit>& units,
            const std::vector<std::uint32_t>& doublings) {
  Spent s;
  for (std::size_t i = 0; i < units.size(); ++i) {
    s.variance += units[i].variance * std::exp2(-2 * kSlope * doublings[i]);
    s.cost += units[i].cost * units[i].samples * (std::exp2(doublings[i]) - 1);
  }
  return s;
}

TEST(AllocateSamples, NothingIsSpentWhereTheErrorIsLowEnough) {
  const std::vector<adaptive::AllocationUnit> units{{3, 64, 4096, 1}, {4, 64, 4096, 1}};
  EXPECT_EQ(allocate_samples(units, 7, kSlope), (std::vector<std::uint32_t>{0, 0}));
  EXPECT_EQ(adaptive::allocate_samples({}, 0, kSlope), std::vector<std::uint32_t>{});
}

TEST(AllocateSamples, NoiseAndPriceDecide) {
  // Noisy and cheap, noisy and dear, without noise, and with samples that can't be more.
  const std::vector<adaptive::AllocationUnit> units{
      {100, 64, 4096, 1}, {100, 64, 4096, 50}, {0, 64, 4096, 1}, {100, 64, 64, 1}};
  const auto doublings = allocate_samples(units, 230, kSlope);
  EXPECT_LE(spent(units, doublings).variance, 230);
  EXPECT_GT(doublings[0], doublings[1]);
  EXPECT_EQ(doublings[2], 0u);
  EXPECT_EQ(doublings[3], 0u);
}

// A unit that can't be helped must not send the others to their limits.
TEST(AllocateSamples, WhatCantBeReachedIsNotChased) {
  const std::vector<adaptive::AllocationUnit> units{
      {1, 16, 4096, 1}, {1, 16, 16, 1}, {1e-6, 16, 4096, 1}};
  EXPECT_EQ(allocate_samples(units, 0.5, kSlope), (std::vector<std::uint32_t>{2, 0, 0}));
}

TEST(AllocateSamples, TheLastStepGoesUpToTheLimit) {
  const std::vector<adaptive::AllocationUnit> units{{1, 64, 100, 1}};
  EXPECT_EQ(allocate_samples(units, 0.6, kSlope), std::vector<std::uint32_t>{1});
  EXPECT_EQ(adaptive::allocate_samples({{{1, 100, 100, 1}}}, 0.6, kSlope),
            std::vector<std::uint32_t>{0});
}

// Against all choices of up to five doublings for each of four units. A price takes units whole, so
// it may spend a little more than the best: less than its own last doubling.
TEST(AllocateSamples, CostsNoMoreThanTheBestChoiceButForItsLastDoubling) {
  std::uint32_t state = 1;
  const auto next = [&state] {
    return double((state = state * 1664525u + 1013904223u) >> 8) / 0x1p24;
  };
  for (int trial = 0; trial < 40; ++trial) {
    std::vector<adaptive::AllocationUnit> units;
    double variance = 0;
    for (int i = 0; i < 4; ++i) {
      units.push_back({std::exp2(8 * next()), 16, 16 << 5, 0.2 + next()});
      variance += units.back().variance;
    }
    const double allowed = variance * (0.05 + 0.9 * next());
    const auto doublings = allocate_samples(units, allowed, kSlope);
    const Spent found = spent(units, doublings);
    ASSERT_LE(found.variance, allowed);
    double best = std::numeric_limits<double>::infinity(), last = 0;
    for (std::uint32_t code = 0; code < 6 * 6 * 6 * 6; ++code) {
      const Spent s = spent(units, {code % 6, code / 6 % 6, code / 36 % 6, code / 216});
      if (s.variance <= allowed) best = std::min(best, s.cost);
    }
    for (std::size_t i = 0; i < units.size(); ++i)
      if (doublings[i] > 0)
        last = std::max(last, units[i].cost * units[i].samples * std::exp2(doublings[i] - 1));
    EXPECT_LE(found.cost, best + last);
  }
}

}  // namespace
}  // namespace kiln::solver
