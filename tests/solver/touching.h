#pragma once

#include <algorithm>
#include <vector>

#include "baker/solver/pairwise/parts.h"

namespace kiln::solver {

/// Tells of each texel whether a surface that it faces is nearer than so many of the texels'
/// widths, or a part of it lies inside of one.
inline std::vector<bool> touches(const World& world, float widths) {
  const pairwise::Parts parts(world);
  std::vector<bool> near(parts.patches.size());
  for (std::uint32_t i = 0; i < near.size(); ++i) {
    if (parts.patches.visible_share(i) < 1) near[i] = true;
    parts.factors.pairs(
        i, i + 1, parts.patches.size(), [&](std::uint32_t j, pairwise::ViewFactors::Factors) {
          const math::Vec3 way = world.texels.position[j] - world.texels.position[i];
          const float area = std::max(world.texels.area_m2[i], world.texels.area_m2[j]);
          if (dot(way, way) < widths * widths * area) near[i] = near[j] = true;
        });
  }
  return near;
}

}  // namespace kiln::solver
