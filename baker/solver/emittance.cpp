#include "baker/solver/emittance.h"

namespace kiln::solver {

math::Rgb texel_emittance(const World& world, std::uint32_t texel) {
  math::Rgb sum;
  for (const atlas::SamplePoint& point : world.texels.points_of(texel))
    if (is_emissive(world.scene, point.triangle))
      sum += emission_at(world.scene, point.triangle, point.bary());
  return sum * (math::kPi / atlas::TextureGroup::kPointsPerTexel);
}

std::vector<math::Rgb> texel_emittance(const World& world) {
  std::vector<math::Rgb> emittance(world.texels.size());
  for (std::uint32_t t = 0; t < emittance.size(); ++t) emittance[t] = texel_emittance(world, t);
  return emittance;
}

std::vector<math::Rgb> sent_emittance(const World& world) {
  return emitters_send(world.settings) ? texel_emittance(world) : std::vector<math::Rgb>();
}

}  // namespace kiln::solver
