#pragma once

#include <cstdint>

#include "baker/lightmap/plane.h"
#include "baker/math/vec.h"

namespace kiln::lightmap {

/// The light on the texels of a TextureGroup, one entry per texel. Also the state that one pass
/// hands to the next, and so the content of a checkpoint. Irradiance in lx, without albedo. Copies
/// share their planes.
struct Lightmap {
  Plane<math::Rgb>
      direct;  ///< by shadow rays: straight from emitters, lights, bright parts of the sky
  Plane<math::Rgb> sky;       ///< by gathering rays: straight from the sky, or what is left of it
  Plane<math::Rgb> indirect;  ///< after one diffuse reflection or more
  /// Share of the footprint that is not inside or behind other geometry, 0..1: all rays from a
  /// hidden point meet back faces. The path method, which sends few rays from a point at a time,
  /// gives the share of the texel's rays that met no back face.
  Plane<float> validity;

  /// How far two halves of the samples differ in luminance, see Estimate::spread.
  Plane<float> direct_spread, sky_spread, indirect_spread;
  /// Shadow rays towards area lights, and directions or paths, that the light was taken from.
  Plane<std::uint32_t> direct_samples, samples;
  /// What the last bounce read, lx: passes that only add samples read it again.
  Plane<math::Rgb> radiosity;
  /// 1 where rays of the texel's own gather, 0 where the light is interpolated from sites around.
  Plane<std::uint8_t> gathers;

  Lightmap() = default;
  explicit Lightmap(std::uint32_t texels)
      : direct(texels),
        sky(texels),
        indirect(texels),
        validity(texels, 1.f),
        direct_spread(texels),
        sky_spread(texels),
        indirect_spread(texels),
        direct_samples(texels),
        samples(texels),
        radiosity(texels),
        gathers(texels, 1) {}

  math::Rgb irradiance(std::uint32_t texel) const {
    return direct[texel] + sky[texel] + indirect[texel];
  }
  std::uint32_t size() const { return direct.size(); }

  /// Calls `use(plane)` for every plane, in the order in which they are stored.
  template <class Light, class Use>
  static void for_planes(Light& light, const Use& use) {
    use(light.direct), use(light.sky), use(light.indirect), use(light.validity);
    use(light.direct_spread), use(light.sky_spread), use(light.indirect_spread);
    use(light.direct_samples), use(light.samples), use(light.radiosity);
    use(light.gathers);
  }
};

}  // namespace kiln::lightmap
