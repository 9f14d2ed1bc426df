#pragma once

#include <cstdint>

#include "baker/simd/kernels.h"
#include "baker/trace/ray_scene.h"
#include "baker/trace/texel_surface.h"

namespace kiln::trace {

/// Holds what sixteen rays have met.
struct alignas(64) Gathered {
  HitPacket hits;
  /// Number of the element whose radiosity the ray brings, or simd::kHitSky, or simd::kHitNothing
  /// for what sends no light. Not set in lanes that are not active.
  std::uint32_t element[16];
};

/// What indirect rays meet: elements of surface that send light. Immutable; callable from many
/// threads.
class GatherSurface {
 public:
  virtual ~GatherSurface() = default;
  /// Follows the active rays. @param pick in [0,1): picks one of the elements around a hit by their
  /// weights @param coherent a promise about the packet, for speed only
  virtual void meet(const RayPacket&, const float (&pick)[16], bool coherent, Gathered&) const = 0;
};

/// The scene's own triangles, whose elements are texels.
class TexelSurface final : public GatherSurface {
 public:
  /// Both outlive this.
  TexelSurface(const RayScene& rays, const TexelLookup& lookup)
      : rays_(rays), lookup_(lookup), kernels_(simd::kernels()), grid_(lookup.grid()) {}

  void meet(const RayPacket&, const float (&pick)[16], bool coherent, Gathered&) const override;

 private:
  const RayScene& rays_;
  const TexelLookup& lookup_;
  const simd::Kernels& kernels_;
  const simd::TexelGrid grid_;
};

}  // namespace kiln::trace
