#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "baker/sampling/estimate.h"

namespace kiln::sampling {

/// The directions of a gather: a run of the Sobol sequence (or, to compare, of independent points)
/// in the order in which it is traced, packets of sixteen. Runs that begin at a multiple of their
/// length, a power of two, are nets, and together with the runs before them again a net.
struct DirectionSet {
  /// Sixteen neighboring strata make a narrow cone of rays from this many samples on.
  static constexpr std::uint32_t kCoherentSamples = 256;

  std::vector<std::uint32_t> x, y;  ///< coordinates, fractions of 2^32, padded to whole packets
  std::uint32_t first = 0;          ///< its place in the sequence
  std::uint32_t count = 0;
  bool coherent = false;  ///< each run of sixteen is a narrow cone
  bool is_low_discrepancy = true;

  /// @param sorted puts directions near to each other into one packet, where they are many enough
  DirectionSet(std::uint32_t first, std::uint32_t count, bool sorted, bool low_discrepancy = true);
  std::uint32_t size() const { return count; }
  /// The first `n` directions of the order: of a net that is a power of two times as long, two
  /// nets. Not of a coherent set, whose packets are each a part of the hemisphere.
  DirectionSet leading(std::uint32_t n) const;

  /// Each half of a net's packets makes half of the net. Which half a direction belongs to:
  bool in_second_half(std::uint32_t i) const {
    return count < 16 ? i >= (count + 1) / 2 : (i >> 3 & 1) != 0;
  }
  /// Makes an estimate of the sums over the two halves.
  Estimate estimate(math::Rgb first_sum, math::Rgb second_sum) const;

 private:
  void count_halves();

  std::uint32_t first_half_ = 0;  ///< directions in the first half
};

}  // namespace kiln::sampling
