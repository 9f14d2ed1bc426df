#include "baker/solver/hidden_points.h"

#include <limits>

#include "baker/sampling/shapes.h"

namespace kiln::solver {
namespace {

/// Returns bits of those rays that meet the back of a surface that has none.
std::uint32_t meet_backs(const World& world, const trace::RayPacket& rays) {
  trace::HitPacket hits;
  world.rays.closest(rays, hits);
  std::uint32_t met = 0;
  for (std::uint32_t i = 0; i < Footprint::kPoints; ++i)
    if (rays.active >> i & 1 && hits.triangle[i] != trace::kNoHit && hits.back[i] != 0 &&
        !world.scene.material_of(hits.triangle[i]).double_sided)
      met |= 1u << i;
  return met;
}

}  // namespace

std::uint32_t hidden_points(const World& world, const Footprint& at) {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  trace::RayPacket rays;
  rays.activate_first(Footprint::kPoints);
  for (std::uint32_t i = 0; i < Footprint::kPoints; ++i)
    rays.set(i, at.origin[i], at.geometric_normal[i], kFar);
  std::uint32_t hidden = meet_backs(world, rays);
  // Three directions around the normal: cosine 1/2, sine √3/2, and thirds of a turn.
  constexpr math::Vec3 kTilted[3] = {
      {0.8660254f, 0, 0.5f}, {-0.4330127f, 0.75f, 0.5f}, {-0.4330127f, -0.75f, 0.5f}};
  for (const math::Vec3& tilted : kTilted) {
    if (hidden == 0) break;
    rays.active = hidden;
    for (std::uint32_t i = 0; i < Footprint::kPoints; ++i) {
      const sampling::Frame frame(at.geometric_normal[i]);
      rays.set(i, at.origin[i], frame.x * tilted.x + frame.y * tilted.y + frame.z * tilted.z, kFar);
    }
    rays.active = hidden;
    hidden = meet_backs(world, rays);
  }
  return hidden;
}

}  // namespace kiln::solver
