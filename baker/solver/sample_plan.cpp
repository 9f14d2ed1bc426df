#include "baker/solver/sample_plan.h"

#include <algorithm>

namespace kiln::solver {
namespace {

/// Samples that a target starts with: about as many as bring the error to within a few doublings
/// of it on a diffuse room, so that few texels get more than they need.
std::uint32_t first_samples(float target_error) {
  if (target_error >= 0.08f) return 16;
  if (target_error >= 0.04f) return 32;
  if (target_error >= 0.008f) return 64;
  return 256;
}

/// Shadow rays that a target starts with where there are many lights.
constexpr std::uint32_t kFirstOfMany = 16;
/// Below this target the bias of interpolated texels would be felt.
constexpr float kFinestCoarseTarget = 0.008f;
/// The samples per texel of a method without a target, when the settings don't say how many.
constexpr std::uint32_t kFixedSamples = 256;
/// The limits of a method that iterates [Moreno-Fortuny 5.2].
constexpr std::uint32_t kIterations = 800, kDirectIterations = 200;

/// The samples at first of both plans.
SamplePlan first_plan(const proto::SolverSettings& solver, const proto::QualitySettings& quality,
                      bool many_lights) {
  SamplePlan plan;
  const float target = proto::target_error(quality);
  const std::uint32_t first = std::min(first_samples(target), quality.max_samples);
  plan.directions = plan.most_directions = solver.samples.value_or(first);
  plan.shadow_rays =
      solver.direct_samples.value_or(many_lights ? std::min(first, kFirstOfMany) : first);
  plan.most_shadow_rays = solver.direct_samples ? plan.shadow_rays : quality.max_samples;
  plan.measure = quality.measure;
  // The light of emitters that arrives with the indirect one has edges that interpolation would
  // blur.
  plan.coarse = solver.coarse_indirect && solver.emitters == proto::Emitters::kExplicit &&
                (solver.samples || target >= kFinestCoarseTarget);
  return plan;
}

}  // namespace

SamplePlan adaptive_plan(const proto::SolverSettings& solver, const proto::QualitySettings& quality,
                         bool many_lights) {
  SamplePlan plan = first_plan(solver, quality, many_lights);
  if (!solver.samples) plan.most_directions = quality.max_samples;
  if (!solver.samples || !solver.direct_samples) plan.target_error = proto::target_error(quality);
  return plan;
}

SamplePlan fixed_plan(const proto::SolverSettings& solver, const proto::QualitySettings& quality,
                      bool many_lights) {
  SamplePlan plan = first_plan(solver, quality, many_lights);
  plan.directions = plan.most_directions = solver.samples.value_or(kFixedSamples);
  return plan;
}

SamplePlan iterated_plan(const proto::SolverSettings& solver, const proto::QualitySettings& quality,
                         bool) {
  SamplePlan plan;
  plan.directions = plan.most_directions = solver.samples.value_or(kIterations);
  plan.shadow_rays = plan.most_shadow_rays = solver.direct_samples.value_or(kDirectIterations);
  plan.target_error = quality.target_error.value_or(0.f);
  plan.measure = quality.measure;
  plan.coarse = false;
  return plan;
}

}  // namespace kiln::solver
