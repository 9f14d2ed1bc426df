#pragma once

#include <span>
#include <vector>

#include "baker/atlas/sample_points.h"
#include "baker/atlas/texture_group.h"
#include "baker/atlas/triangle_setup.h"

namespace kiln::atlas {

/// Computes a texel's surface from the fragments of triangles that it owns. Each thread needs one
/// of its own, since it caches the set-ups of recent triangles.
class TexelFiller {
 public:
  TexelFiller(const scene::Scene& scene, const Atlas& atlas)
      : scene_(scene), setups_(scene, atlas) {}

  /// Fills every plane of `texel` except its place, chart and back; the planes must have their full
  /// size. Returns whether the albedo was capped. Requires at least one fragment, each of positive
  /// area.
  bool fill(TextureGroup&, std::uint32_t texel, std::span<const Fragment>);

 private:
  void fill_surface(TextureGroup&, std::uint32_t texel, std::span<const Fragment>);
  bool fill_albedo(TextureGroup&, std::uint32_t texel);

  const scene::Scene& scene_;
  SetupCache setups_;
};

}  // namespace kiln::atlas
