#pragma once

#include "baker/solver/pairwise/patches.h"
#include "baker/solver/pairwise/view_factors.h"
#include "baker/trace/visibility.h"

namespace kiln::solver::pairwise {

/// What all passes of one bake share. Immutable; stays where it is.
struct Parts {
  /// @param w outlives this
  explicit Parts(const World& w)
      : world(w),
        patches(w, w.settings.pair_samples),
        visibility(w.rays),
        factors(patches, visibility, w.settings.distance_factor) {}
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;

  /// Returns the share of the light on a texel that it sends on: ρ · albedo [RTRad eq. 4.8].
  math::Rgb reflectance(std::uint32_t texel) const {
    return world.texels.albedo[texel] * world.settings.reflectivity_factor;
  }

  const World& world;
  const Patches patches;
  const trace::RayVisibility visibility;
  const ViewFactors factors;
};

}  // namespace kiln::solver::pairwise
