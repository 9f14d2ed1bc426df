#pragma once

#include <cstdint>

#include "baker/sampling/estimate.h"
#include "baker/solver/radiosity_map/series.h"
#include "baker/solver/world.h"

namespace kiln::solver::radiosity_map {

/// Samples direct light as the thesis does, a point of the emitters at a time:
///
///   E = mean of Φ V cosθ_x cosθ_y / (π r²)  [Moreno-Fortuny eq. 3.12; B = ρ E: its π is that of
///   eq. 3.11 already]
///
/// Φ is the flux of all emitters. An emitter is drawn by its share in Φ, and a point on it as
/// `solver.light_sampling` says. Each sample also draws one punctual light, and a direction to the
/// bright parts of a sky map. Immutable; callable from many threads.
class EmitterLight {
 public:
  /// @param world outlives this
  explicit EmitterLight(const World& world);

  /// Returns the mean over a run of samples, lx. The half difference is that of two halves of the
  /// run; of one sample it is plus or minus its luminance. @param rays grows by those traced
  sampling::Estimate arriving(std::uint32_t texel, Run, std::uint64_t& rays) const;

  /// Returns the shadow rays of one sample.
  double rays_per_sample() const;

 private:
  class Sampler;

  const World& world_;
  const light::SkyShares shares_;
};

}  // namespace kiln::solver::radiosity_map
