#pragma once

#include <cstdint>

#include "baker/light/sky_light.h"
#include "proto/bake_settings.h"

namespace kiln::solver {

/// How many samples a gather takes of each texel: so many at first, and then twice as many again
/// and again where the error is above its target.
struct SamplePlan {
  std::uint32_t directions = 64, most_directions = 64;    ///< over the hemisphere
  std::uint32_t shadow_rays = 64, most_shadow_rays = 64;  ///< towards area lights
  float target_error = 0;  ///< of the lightmap, see SampleRounds; 0: `most` for every texel
  proto::ErrorMeasure measure = proto::ErrorMeasure::kPercentile95;
  bool coarse = true;  ///< gather indirect light at every second texel, see CoarseSites
};

/// The samples at first are what weighs the two ways of finding the sky: rounds add to either, and
/// each estimates its own part of the sky's light whatever their number.
inline light::SkyShares sky_shares(const SamplePlan& plan) {
  return {float(plan.shadow_rays), float(plan.directions)};
}

/// @param many_lights DirectLight::are_many(): a ray towards one of them costs
/// several times as much, so few are sent before there is a first picture
SamplePlan sample_plan(const proto::SolverSettings&, const proto::QualitySettings&,
                       bool many_lights = false);

}  // namespace kiln::solver
