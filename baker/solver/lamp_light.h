#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/solver/footprint.h"
#include "baker/solver/simd/kernels.h"
#include "baker/solver/solver.h"

namespace kiln::baker {

/// A texel's light from one uniform lamp: Lambert's polygon formula at each point of the footprint
/// times the visible share that shadow rays find, the rays weighted by what they would bring. Where
/// nothing or everything stands between, the result is exact; in the half-shadow the ratio has a
/// bias of the order of 1/rays, without the noise of the unoccluded light.
class LampLight {
 public:
  explicit LampLight(const SolverInput& in) : in_(in), kernels_(kernels()) {}

  /// A lamp as the points of one texel see it.
  struct View {
    float irradiance[Footprint::kPoints];  ///< at unit radiance; 0 where the lamp is turned away
    float mean = 0;                        ///< over the points
    bool exact = true;  ///< false: the closed form has lost its digits, good for importance only
  };
  View view(const AreaLight&, const Footprint&, const PointFrames&) const;

  /// Irradiance per unit radiance, with half the difference between two halves of the rays.
  struct Arrived {
    float irradiance = 0, spread = 0;
  };
  /// @param first packets that were sent before, of the same sequence
  /// @param packets one shadow ray from each point; at least 1
  /// @param traced receives the rays, added
  Arrived arrive(const AreaLight&, const View&, const Footprint&, const PointFrames&,
                 std::uint32_t first, std::uint32_t packets, std::uint32_t seed,
                 std::uint64_t& traced) const;

 private:
  void near_rays(const AreaLight&, const Footprint&, const std::uint32_t* x, const std::uint32_t* y,
                 std::uint32_t flip, std::uint32_t seed, LightRays&) const;

  const SolverInput& in_;
  const Kernels& kernels_;
};

}  // namespace kiln::baker
