#include "baker/solver/sample_plan.h"

#include <gtest/gtest.h>

#include "baker/methods.h"

namespace kiln::solver {
namespace {

using baker::sample_plan;

TEST(SamplePlan, StartsWithMoreTheFinerTheTarget) {
  std::uint32_t before = 0;
  for (const float target : {0.1f, 0.05f, 0.018f, 0.005f}) {
    const SamplePlan plan = sample_plan({}, {.target_error = target});
    EXPECT_EQ(plan.directions, plan.shadow_rays);
    EXPECT_GT(plan.directions, before);
    EXPECT_EQ(plan.most_directions, 4096u);
    EXPECT_EQ(plan.target_error, target);
    before = plan.directions;
  }
}

TEST(SamplePlan, ManyLightsAreLookedAtByFewRaysFirst) {
  const SamplePlan plan = sample_plan({}, {}, true);
  EXPECT_EQ(plan.shadow_rays, 16u);
  EXPECT_EQ(plan.directions, sample_plan({}, {}).directions);
  EXPECT_EQ(plan.most_shadow_rays, 4096u);
}

TEST(SamplePlan, WhatSettingsFixStays) {
  proto::SolverSettings s;
  s.samples = 100, s.direct_samples = 200;
  const SamplePlan plan = sample_plan(s, {}, true);
  EXPECT_EQ(plan.directions, 100u);
  EXPECT_EQ(plan.most_directions, 100u);
  EXPECT_EQ(plan.shadow_rays, 200u);
  EXPECT_EQ(plan.most_shadow_rays, 200u);
  EXPECT_EQ(plan.target_error, 0) << "nothing is left to aim with";
}

TEST(SamplePlan, OnlyMethodsWithATargetHaveOne) {
  for (const baker::Method& method : baker::methods()) {
    proto::SolverSettings s;
    s.method = method.id;
    const SamplePlan plan = sample_plan(s, {.target_error = 0.05f});
    // radiosity_map takes no rounds, but ends at a target.
    const bool ends_at_target = method.adaptive || method.id == proto::Method::kRadiosityMap;
    EXPECT_EQ(plan.target_error > 0, ends_at_target) << method.name();
    EXPECT_EQ(plan.most_directions > plan.directions, method.adaptive) << method.name();
    s.samples = 24;
    EXPECT_EQ(sample_plan(s, {}).directions, 24u) << method.name();
  }
}

}  // namespace
}  // namespace kiln::solver
