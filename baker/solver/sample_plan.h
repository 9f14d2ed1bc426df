#pragma once

#include <cstdint>

#include "baker/light/sky_light.h"
#include "proto/bake_settings.h"

namespace kiln::solver {

/// Texels that take samples together: a run of indices, an 8x8 block of a page as a rule.
inline constexpr std::uint32_t kSampleTileTexels = 64;

/// The number of samples that a method takes of each texel: a first number, and twice as many again
/// and again while the error is above its target.
struct SamplePlan {
  std::uint32_t directions = 64, most_directions = 64;    ///< over the hemisphere
  std::uint32_t shadow_rays = 64, most_shadow_rays = 64;  ///< towards area lights
  /// The directions that are followed before the first round: fewer than `directions` when the hits
  /// of all would not fit into their memory. 0: all.
  std::uint32_t first_directions = 0;
  float target_error = 0;  ///< the lightmap's error, see ErrorJudge; 0: `most` for every texel
  proto::ErrorMeasure measure = proto::ErrorMeasure::kPercentile95;
  bool coarse = true;  ///< gather indirect light at every second texel, see InterpolationGrid

  std::uint32_t followed_first() const {
    return first_directions > 0 ? first_directions : directions;
  }
};

/// Returns the weights of the two ways of finding the sky, by the samples at first. Rounds add to
/// either, and each estimates its own part of the sky's light whatever their number.
inline light::SkyShares sky_shares(const SamplePlan& plan) {
  return {float(plan.shadow_rays), float(plan.directions)};
}

/// Returns the plan of a method that takes samples until the target of the quality is reached.
/// @param many_lights DirectLight::are_many(): a ray towards one of them costs several times as
/// much, so few are sent before there is a first picture
SamplePlan adaptive_plan(const proto::SolverSettings&, const proto::QualitySettings&,
                         bool many_lights);
/// Returns the plan of a method that takes as many as the settings say, or 256.
SamplePlan fixed_plan(const proto::SolverSettings&, const proto::QualitySettings&,
                      bool many_lights);
/// Returns the plan of a method that iterates until limits, 800 directions and 200 shadow rays
/// where the settings say nothing, or until a target error that the settings name themselves.
SamplePlan iterated_plan(const proto::SolverSettings&, const proto::QualitySettings&,
                         bool many_lights);

}  // namespace kiln::solver
