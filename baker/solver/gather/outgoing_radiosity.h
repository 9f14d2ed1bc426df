#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/sampling/direction_set.h"
#include "baker/simd/kernels.h"
#include "baker/solver/world.h"

namespace kiln::solver::gather {

/// The radiosity that gathering rays read at what they meet: light times albedo, and what emitters
/// send that no shadow rays look for; mended where texels lie hidden. Light is linear: a bounce
/// reads only what the one before it has changed.
class OutgoingRadiosity {
 public:
  /// @param emittance M of the texels, see sent_emittance(); outlives this
  OutgoingRadiosity(const World& world, std::span<const math::Rgb> emittance)
      : world_(world), emittance_(emittance) {}

  /// Looks for hidden texels by Lightmap::validity. Until then none is mended.
  void find_hidden(const lightmap::Lightmap&);

  /// Takes from the light by how much B has grown since Lightmap::radiosity [RTRad 5.4], or all of
  /// it when there is no such plane. Returns false when stopped.
  /// @param once indirect light is not sent on
  bool read(const lightmap::Lightmap&, const exec::Workers&, bool once = false);
  /// Scales all values, since the last update stands for those after it, too.
  void scale(float);
  /// Takes the values of a plane.
  void restore(const lightmap::Plane<math::Rgb>& radiosity);

  math::Rgb radiosity(std::uint32_t texel) const {
    const Radiosity& b = radiosity_[texel];
    return {b.r, b.g, b.b};
  }
  /// Returns the mean of the radiosity at the hits, lx; sky and nothing count as dark.
  sampling::Estimate look_up(const sampling::DirectionSet&,
                             std::span<const std::uint32_t> hits) const;

 private:
  /// The radiosity as the look-ups read it: one aligned load.
  struct alignas(16) Radiosity {
    float r = 0, g = 0, b = 0, pad = 0;
  };
  /// A texel that lies hidden, whose radiosity comes from the texels around it: a ray that meets
  /// the surface beside it must not read the dark beneath a block that stands there.
  struct Repair {
    std::uint32_t texel = 0;
    std::uint32_t count = 0;
    std::array<std::uint32_t, 8> neighbor{};
  };

  const World& world_;
  const std::span<const math::Rgb> emittance_;
  std::vector<Radiosity> radiosity_;
  std::vector<Repair> repairs_;
};

}  // namespace kiln::solver::gather
