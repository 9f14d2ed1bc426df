#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "baker/generate/shapes.h"

/// Closed meshes of sculpted solids in few rectangular charts. A cage of cubes, roughly of the
/// solid's shape, is drawn onto the solid: each side of the cage becomes a chart, and all charts
/// together one closed surface. Internal to this folder.
namespace kiln::generate {

/// Cubes of a lattice: low <= x < high on each axis.
struct CageBox {
  std::array<int, 3> low, high;
};

/// A union of boxes. No two of its cubes may touch in an edge or a corner alone.
struct Cage {
  std::vector<CageBox> boxes;
  /// Returns where a lattice point starts, near the solid's surface.
  std::function<math::Vec3(math::Vec3 lattice)> place;
  float cube_m = 1;  ///< about the size of a cube, the farthest that a point moves in one step
};

/// About the distance to the solid's surface, negative inside. Coarse meshes see the solid without
/// its fine relief (`coarse` is 1 instead of 0), so that they don't crumple in it.
using Solid = std::function<float(math::Vec3, float coarse)>;

/// Adds the surface of `solid` with `cells` x `cells` cells on each side of a cube of the cage.
void add_wrapped(SceneBuilder&, const Part&, const Cage&, const Solid&, std::uint32_t cells);

}  // namespace kiln::generate
