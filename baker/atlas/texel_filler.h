#pragma once

#include <span>
#include <vector>

#include "baker/atlas/sample_points.h"
#include "baker/atlas/texture_group.h"
#include "baker/atlas/triangle_setup.h"

namespace kiln::atlas {

/// Works out what a texel's surface is like from the pieces of triangles that it owns. One per
/// thread: it keeps the set-ups of the triangles at hand.
class TexelFiller {
 public:
  TexelFiller(const scene::Scene& scene, const Atlas& atlas)
      : scene_(scene), setups_(scene, atlas) {}

  /// Fills everything of `texel` but its place, chart and back; the planes must have their full
  /// size. Returns whether its albedo was capped. Requires at least one piece, each of positive
  /// area.
  bool fill(TextureGroup&, std::uint32_t texel, std::span<const Piece>);

 private:
  void fill_surface(TextureGroup&, std::uint32_t texel, std::span<const Piece>);
  bool fill_colours(TextureGroup&, std::uint32_t texel);

  const scene::Scene& scene_;
  SetupCache setups_;
};

}  // namespace kiln::atlas
