#include "baker/trace/gather_surface.h"

namespace kiln::trace {

void TexelSurface::meet(const RayPacket& rays, const float (&pick)[16], bool coherent,
                        Gathered& met) const {
  const HitPacket& hits = met.hits;
  rays_.closest(rays, met.hits, coherent);
  kernels_.look_up(grid_, hits.triangle, hits.u, hits.v, hits.back, pick, met.element);
  for (std::uint32_t i = 0; i < 16; ++i) {
    if (!(rays.active >> i & 1) || met.element[i] != simd::kHitUnclear) continue;
    const std::int32_t t =
        lookup_.pick(hits.triangle[i], {hits.u[i], hits.v[i]}, hits.back[i] != 0, pick[i]);
    met.element[i] = t != atlas::kNoTexel ? static_cast<std::uint32_t>(t) : simd::kHitNothing;
  }
}

}  // namespace kiln::trace
