#include "baker/progress/eta.h"

#include <gtest/gtest.h>

namespace kiln::baker {
namespace {

using std::chrono::milliseconds;

solver::PassPlan pass_of(solver::Work work, solver::Work finish = {}) {
  solver::PassPlan pass;
  pass.work = work, pass.finish_work = finish;
  return pass;
}

/// A clock that the test sets.
const progress::EtaEstimator::Clock::time_point kStart{};

TEST(EtaEstimator, KnowsNothingAtFirst) {
  const progress::EtaEstimator pace({}, kStart);
  const progress::EtaEstimator::Ahead ahead =
      pace.ahead(pass_of(solver::Work::shadow_rays(10)), 0.1, solver::Work::shadow_rays(20),
                 kStart + milliseconds(50));
  EXPECT_FALSE(ahead.seconds_left);
  EXPECT_DOUBLE_EQ(ahead.share_done, 0.05);
}

TEST(EtaEstimator, GoesOnAtItsPace) {
  const progress::EtaEstimator pace({}, kStart);
  const progress::EtaEstimator::Ahead ahead =
      pace.ahead(pass_of(solver::Work::shadow_rays(10)), 0.5, solver::Work::shadow_rays(20),
                 kStart + milliseconds(500));
  ASSERT_TRUE(ahead.seconds_left);
  EXPECT_NEAR(*ahead.seconds_left, 1.5, 1e-9);
}

TEST(EtaEstimator, EveryKindOfWorkHasItsOwn) {
  progress::EtaEstimator pace({}, kStart);
  const solver::Work all =
      solver::Work::shadow_rays(10) + solver::Work::directions(10) + solver::Work::other(10);
  auto now = kStart + milliseconds(1000);
  pace.end_pass(pass_of(solver::Work::shadow_rays(10)), now);
  // Directions are four times as slow. What is not known yet goes as the others do together.
  const solver::PassPlan directions = pass_of(solver::Work::directions(10));
  EXPECT_NEAR(*pace.ahead(directions, 0.5, all, now + milliseconds(2000)).seconds_left,
              2 + 10 * (3. / 15), 1e-9);
  now += milliseconds(4000);
  pace.end_pass(directions, now);
  EXPECT_NEAR(*pace.ahead(pass_of(solver::Work::other(10)), 0, all, now).seconds_left,
              10 * (5. / 20), 1e-9);
  // A round of both kinds takes half as long again as it should: both are held to be slower.
  const solver::PassPlan round =
      pass_of(solver::Work::shadow_rays(10) + solver::Work::directions(10));
  const solver::Work more = all + round.work;
  EXPECT_NEAR(*pace.ahead(round, 0.5, more, now + milliseconds(3750)).seconds_left,
              0.5 * (10 * 1.75 / 15 + 10 * 7. / 15) + 10 * (8.75 / 30), 0.3);
}

// A pass needs a second before its first batch: one per cent done in a second is no rate yet.
TEST(EtaEstimator, WhatAPassDoesFirstIsNotItsRate) {
  progress::EtaEstimator pace({}, kStart);
  const solver::Work all = solver::Work::shadow_rays(10) + solver::Work::directions(100);
  const auto now = kStart + milliseconds(10000);
  pace.end_pass(pass_of(solver::Work::shadow_rays(10)), now);
  const solver::PassPlan next = pass_of(solver::Work::directions(100));
  EXPECT_LT(*pace.ahead(next, 0.01, all, now + milliseconds(2000)).seconds_left, 120)
      << "by the first batch alone it would be 198";
  EXPECT_NEAR(*pace.ahead(next, 0.2, all, now + milliseconds(21000)).seconds_left, 84, 1e-6)
      << "then what was measured";
}

TEST(EtaEstimator, WhatComesAfterThePassesBatchesIsLeft) {
  const progress::EtaEstimator pace({}, kStart);
  const solver::PassPlan pass = pass_of(solver::Work::other(10), solver::Work::other(10));
  EXPECT_NEAR(
      *pace.ahead(pass, 1, solver::Work::other(20), kStart + milliseconds(500)).seconds_left, 0.5,
      1e-9);
}

TEST(EtaEstimator, AnEarlierAttemptCountsAsDoneButTellsNoSpeed) {
  const progress::EtaEstimator pace(solver::Work::shadow_rays(100), kStart);
  const solver::PassPlan pass = pass_of(solver::Work::shadow_rays(10));
  const progress::EtaEstimator::Ahead ahead =
      pace.ahead(pass, 1, solver::Work::shadow_rays(120), kStart + milliseconds(500));
  EXPECT_NEAR(*ahead.seconds_left, 0.5, 1e-9);
  EXPECT_NEAR(ahead.share_done, 110. / 120, 1e-9);
}

TEST(EtaEstimator, BatchesOfAnEarlierAttemptTellNoSpeedEither) {
  progress::EtaEstimator pace({}, kStart);
  const solver::Work all = solver::Work::shadow_rays(200);
  const solver::PassPlan pass = pass_of(solver::Work::shadow_rays(100));
  pace.resume_within(0.9);
  const auto now = kStart + milliseconds(500);
  EXPECT_NEAR(*pace.ahead(pass, 0.95, all, now).seconds_left, 10.5, 1e-9);
  EXPECT_NEAR(pace.ahead(pass, 0.95, all, now).share_done, 95. / 200, 1e-9);
  pace.end_pass(pass, kStart + milliseconds(1000));
  EXPECT_NEAR(*pace.ahead(pass, 0, all, kStart + milliseconds(1000)).seconds_left, 10, 1e-9);
}

}  // namespace
}  // namespace kiln::baker
