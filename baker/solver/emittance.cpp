#include "baker/solver/emittance.h"

namespace kiln::solver {

std::vector<math::Rgb> texel_emittance(const World& world) {
  std::vector<math::Rgb> emittance(world.texels.size());
  for (std::uint32_t t = 0; t < emittance.size(); ++t) {
    math::Rgb sum;
    for (const atlas::SamplePoint& point : world.texels.points_of(t))
      if (is_emissive(world.scene, point.triangle))
        sum += emission_at(world.scene, point.triangle, point.bary());
    emittance[t] = sum * (math::kPi / atlas::TextureGroup::kPointsPerTexel);
  }
  return emittance;
}

}  // namespace kiln::solver
