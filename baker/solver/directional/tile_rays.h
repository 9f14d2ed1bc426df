#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "baker/sampling/estimate.h"
#include "baker/solver/directional/radiosity_mips.h"
#include "baker/solver/directional/ring_order.h"
#include "baker/solver/world.h"

namespace kiln::solver::directional {

/// What the directions of a texel bring.
struct Gathered {
  sampling::Estimate light;  ///< E, lx
  /// Share of the footprint that is not inside other geometry, see Lightmap::validity; 1 where too
  /// few rays were sent to know.
  float visible = 1;
};

/// Follows the directions of texels, and reads the radiosity of what they meet. Immutable; callable
/// from many threads.
class TileRays {
 public:
  /// This many texels are followed together: lane = texel, all with about the same direction. What
  /// a texel gets does not depend on the others.
  static constexpr std::uint32_t kTexels = 16;

  /// All outlive this.
  TileRays(const World&, const RingOrder&, const RadiosityMips&);

  /// Follows the directions of the texels [first, first + count), of at most kTexels.
  std::array<Gathered, kTexels> follow(std::uint32_t first, std::uint32_t count) const;

 private:
  class Group;

  const World& world_;
  const RingOrder& order_;
  const RadiosityMips& radiosity_;
  const bool as_rtrad_, reads_mips_;
  float rtrad_unit_m_ = 1;  ///< half the longest side of the scene, which RTRad scales to 1
};

}  // namespace kiln::solver::directional
