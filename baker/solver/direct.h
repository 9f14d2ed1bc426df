#pragma once

#include <cstdint>
#include <span>

#include "baker/solver/footprint.h"
#include "baker/solver/solver.h"

namespace kiln::baker {

/// Direct light by explicit sampling. Area lights share `direct_samples` shadow rays per texel,
/// drawn systematically from a distribution of unoccluded contributions: of each texel where lights
/// are few, of each run of 16 texels where they are many. Every punctual light gets a ray from each
/// point of the footprint. Unbiased. Immutable; callable from many threads.
class DirectLight {
 public:
  explicit DirectLight(const SolverInput& in) : in_(in) {}

  /// Irradiance, lx, of the texels of `range` into `irradiance` (indexed by texel).
  /// @param range begins at a multiple of 16
  /// @return rays traced
  std::uint64_t run(TexelRange range, std::span<Rgb> irradiance) const;

 private:
  const SolverInput& in_;
};

}  // namespace kiln::baker
