#pragma once

#include <cstdint>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/scene/scene.h"

namespace kiln::baker {

inline constexpr std::int32_t kNoTexel = -1;

/// From a point of the surface to the texel that holds its light.
class TexelLookup {
 public:
  TexelLookup(const Scene&, const Atlas&, const TextureGroup&);

  /// One of the four texels around the point, picked by `u` in [0,1) with the probability of its
  /// bilinear weight times its coverage; texels of other charts weigh nothing. The mean over u is
  /// the bilinear look-up, at the cost of one fetch. `back` asks for the side behind. kNoTexel when
  /// no texel near the point belongs to the surface, or the surface is one-sided and `back` is set.
  std::int32_t pick(std::uint32_t triangle, Bary, bool back, float u) const;

 private:
  std::int32_t nearest(const TextureGroup::Page&, std::uint32_t chart, Vec2 uv) const;

  const Scene& scene_;
  const Atlas& atlas_;
  const TextureGroup& texels_;
};

}  // namespace kiln::baker
