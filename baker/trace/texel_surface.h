#pragma once

#include <cstdint>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/scene/scene.h"
#include "baker/simd/kernels.h"

namespace kiln::trace {

/// Finds the texel that holds the light of a point of the surface.
class TexelLookup {
 public:
  TexelLookup(const scene::Scene&, const atlas::Atlas&, const atlas::TextureGroup&);

  /// Returns one of the four texels around the point, picked by `u` in [0,1) with the probability
  /// of its bilinear weight times its coverage; texels of other charts weigh nothing. The mean over
  /// u is the bilinear look-up, at the cost of one fetch. `back` asks for the side behind. Returns
  /// kNoTexel when no texel near the point belongs to the surface, or when the surface is one-sided
  /// and `back` is set.
  std::int32_t pick(std::uint32_t triangle, scene::Bary, bool back, float u) const;

  /// Returns the same for the common case, sixteen at a time: the grid for LookupKernel.
  simd::TexelGrid grid() const { return {cells_.data(), triangles_.data(), width_}; }

 private:
  void fill_grid();

  std::int32_t nearest(const atlas::TextureGroup::Page&, std::uint32_t chart, math::Vec2 uv) const;

  const scene::Scene& scene_;
  const atlas::Atlas& atlas_;
  const atlas::TextureGroup& texels_;
  std::vector<std::int32_t> cells_;  ///< see TexelGrid
  std::vector<simd::PlacedTriangle> triangles_;
  std::int32_t width_ = 0;
};

}  // namespace kiln::trace
