#pragma once

#include <cstdint>
#include <span>

#include "baker/solver/direction_set.h"
#include "baker/solver/simd/kernels.h"
#include "baker/solver/solver.h"

namespace kiln::baker {

/// Rays over the hemispheres of a texel's footprint, to the texels that hold the light of what they
/// meet. Immutable; callable from many threads.
class Hemisphere {
 public:
  explicit Hemisphere(const SolverInput&);

  /// Follows the directions of one texel, dealt over the points of its footprint.
  /// @param hits receives one entry per direction: a texel, kHitSky or kHitNothing
  void follow(std::uint32_t texel, const DirectionSet&, std::span<std::uint32_t> hits) const;
  /// The same, and tells the share of the footprint that is not hidden: all rays from a hidden
  /// point meet the backs of surfaces. Sends more rays where few of them met backs.
  float follow_and_probe(std::uint32_t texel, const DirectionSet&,
                         std::span<std::uint32_t> hits) const;

 private:
  struct Census;
  Census trace(std::uint32_t texel, const DirectionSet&, std::span<std::uint32_t> hits) const;

  const SolverInput& in_;
  const Kernels& kernels_;
  const DirectionSet probe_;
};

}  // namespace kiln::baker
