#pragma once

#include <cstdint>
#include <vector>

#include "baker/math/vec.h"

namespace kiln::baker {

/// The light on the texels of a TextureGroup, one entry per texel. Also the state that one pass
/// hands to the next, and so the content of a checkpoint. Irradiance in lx, without albedo.
struct Lightmap {
  std::vector<Rgb> direct;    ///< straight from emitters and punctual lights
  std::vector<Rgb> sky;       ///< straight from the sky
  std::vector<Rgb> indirect;  ///< after one diffuse reflection or more
  /// Share of the footprint that is not inside or behind other geometry, 0..1: all rays from a
  /// hidden point meet back faces. The path method, which sends few rays from a point at a time,
  /// gives the share of the texel's rays that met no back face.
  std::vector<float> validity;

  Lightmap() = default;
  explicit Lightmap(std::uint32_t texels)
      : direct(texels), sky(texels), indirect(texels), validity(texels, 1.f) {}

  Rgb irradiance(std::uint32_t texel) const { return direct[texel] + sky[texel] + indirect[texel]; }
  std::uint32_t size() const { return static_cast<std::uint32_t>(direct.size()); }
};

}  // namespace kiln::baker
