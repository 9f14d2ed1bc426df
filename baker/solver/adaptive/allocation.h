#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace kiln::solver::adaptive {

/// Texels that take samples together, and the error that theirs leave.
struct AllocationUnit {
  double variance = 0;  ///< variance of the light, summed over the texels
  double samples = 0;   ///< each texel has
  double most = 0;      ///< it may have
  double cost = 0;      ///< cost of one more sample for every texel, in any unit
};

/// Returns how often each unit doubles its samples so that the variance of all comes down to
/// `allowed` at the least cost, if a unit's error falls with N^-slope. The last doubling may be a
/// part of one, up to `most`.
///
/// At the least cost the last doubling of every unit takes away the same variance for its cost (the
/// condition of Lagrange), so a unit doubles while it takes away more than one price. When the most
/// samples leave more than `allowed`, the aim is a quarter above what they leave, since the last
/// part of it would cost most and show least.
std::vector<std::uint32_t> allocate_samples(std::span<const AllocationUnit>, double allowed,
                                            double slope);

}  // namespace kiln::solver::adaptive
