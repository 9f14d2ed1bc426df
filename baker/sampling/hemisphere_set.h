#pragma once

#include <cstdint>
#include <vector>

#include "baker/math/vec.h"

namespace kiln::sampling {

/// Directions of the hemisphere about +z with weights, so that Σ weight · B is an estimate of E,
/// where B = πL is the radiosity that arrives. They are the same for every texel.
///
/// Two halves of a set estimate E each for itself, with weights of their own. Σ contrast · B is
/// half of their difference, times what makes it the error of the whole, see
/// Estimate::half_difference.
struct HemisphereSet {
  std::vector<float> x, y, z;  ///< unit
  std::vector<float> weight;   ///< the share of E that a direction stands for; sums to 1
  std::vector<float> contrast;

  std::uint32_t size() const { return std::uint32_t(x.size()); }
  void add(math::Vec3 direction, float its_weight, float its_contrast);
  /// Returns the solid angle that a direction stands for, sr.
  float solid_angle(std::uint32_t i) const;
};

/// Which directions and weights the points of a largest-empty-circle set stand for.
enum class DiscRule {
  /// The points themselves, lifted to (x, y, √(1 - x² - y²)), with equal weights [RTRad eqs. 5.8,
  /// 5.9].
  kAsPrinted,
  /// The centroids of the points' Voronoi cells, lifted, with the area of the cells as weights. No
  /// direction lies in the surface, as those of the many points on the border do. While the holes
  /// of
  /// one size are being filled one after the other, points are denser here than there; this makes
  /// up
  /// for it.
  kCells,
};

/// Returns a largest-empty-circle set of the disc as directions, whose density times weight is
/// cosθ/π. The halves are the first points, which are a set themselves, and the rest.
HemisphereSet disc_directions(std::uint32_t count, std::uint64_t seed, DiscRule);

/// Returns the directions to the middles of the cells of half a cube, weighted by the view factors
/// of the cells [Cohen and Greenberg, "The Hemi-Cube", SIGGRAPH 1985; RTRad 2.8.2]. The product of
/// these weights with what arrives is Elias's cosine map [RTRad §7.4]. A resolution R has 3 R²
/// cells; R is even, so that they come as near to `count` as can be. The halves are the fields of a
/// chessboard.
HemisphereSet hemicube_directions(std::uint32_t count);

}  // namespace kiln::sampling
