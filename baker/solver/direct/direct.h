#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "baker/sampling/estimate.h"
#include "baker/solver/footprint.h"
#include "baker/solver/world.h"

namespace kiln::solver::direct {

/// Samples direct light explicitly. Area lights share the shadow rays of a texel by their
/// unoccluded contributions. When lights are few, those that earn a ray from each point are lamps
/// (see PolygonLight). The others, and all when they are many, are drawn systematically from the
/// distribution of the texel, or of each run of 16 texels.
///
/// Every punctual light gets a ray from each point of the footprint. Bright parts of a sky map are
/// drawn from it. Immutable; callable from many threads.
class DirectLight {
 public:
  explicit DirectLight(const World& world) : world_(world) {}

  /// With up to this many lights each texel weighs them for itself.
  static constexpr std::size_t kFewLights = 16;
  static bool are_many(const light::LightSet& lights) { return lights.area().size() > kFewLights; }

  using Put =
      std::function<void(std::uint32_t texel, const sampling::Estimate&)>;  ///< irradiance, lx
  /// Calls `put` for the texels of `range`, which begins at a multiple of 16.
  /// @param first shadow rays that were sent before, of the same sequence
  /// @param count shadow rays towards area lights
  /// @return rays traced
  std::uint64_t run(atlas::TexelRange range, std::uint32_t first, std::uint32_t count,
                    const Put& put) const;

 private:
  const World& world_;
};

}  // namespace kiln::solver::direct
