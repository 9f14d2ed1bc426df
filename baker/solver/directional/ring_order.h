#pragma once

#include <cstdint>
#include <vector>

#include "baker/sampling/hemisphere_set.h"

namespace kiln::solver::directional {

/// The directions of a set in the order in which every texel sends them: ring by ring around the
/// normal, and around each ring. A texel that turns the set about its normal begins each ring as
/// many directions earlier as it turns, so that texels send about the same direction at a time
/// whatever their turns: packets of rays from neighboring texels stay together.
struct RingOrder {
  struct Ring {
    std::uint32_t begin = 0, size = 0;
  };

  explicit RingOrder(const sampling::HemisphereSet&);

  sampling::HemisphereSet set;     ///< in this order
  std::vector<float> solid_angle;  ///< of each direction, sr
  std::vector<Ring> rings;

  /// Returns the place of the direction that a texel sends as number k of a ring.
  /// @param turn the angle by which the texel turns the set, in turns, in [0, 1)
  static std::uint32_t start_of(const Ring& ring, float turn) {
    const auto back = std::uint32_t(turn * float(ring.size) + 0.5f);
    return back >= ring.size ? 0 : (ring.size - back) % ring.size;
  }
};

}  // namespace kiln::solver::directional
