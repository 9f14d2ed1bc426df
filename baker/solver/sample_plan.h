#pragma once

#include <cstdint>

#include "proto/bake_settings.h"

namespace kiln::baker {

/// How many samples a gather takes of each texel: so many at first, and then twice as many again
/// and again where the error is above its target.
struct SamplePlan {
  std::uint32_t directions = 64, most_directions = 64;    ///< over the hemisphere
  std::uint32_t shadow_rays = 64, most_shadow_rays = 64;  ///< towards area lights
  float target_error = 0;  ///< of the lightmap, see SampleRounds; 0: `most` for every texel
  bool coarse = true;      ///< gather indirect light at every second texel, see CoarseSites
};

SamplePlan sample_plan(const proto::SolverSettings&, const proto::QualitySettings&);

}  // namespace kiln::baker
