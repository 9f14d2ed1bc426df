#pragma once

#include <cstdint>
#include <vector>

#include "baker/math/vec.h"

namespace kiln::sampling {

/// Returns a progressive set of points of the unit disc, its border included, of which any first
/// few are spread evenly [RTRad §5.4.1, alg. 9; Laine et al., "Incremental Instant Radiosity for
/// Real-Time Indirect Illumination", EGSR 2007]. Four random points come first. Each one after them
/// is the center of the largest circle that holds none of those before it: a vertex of their
/// Voronoi diagram that lies in the disc, or a point where one of its edges leaves the disc. The
/// border itself does not bound a circle, so a set has many points on it.
///
/// A longer set of the same seed begins with the shorter ones. 4,096 points take about a tenth of a
/// second; the time grows with the square of the number.
std::vector<math::Vec2d> largest_empty_circle_points(std::uint32_t count, std::uint64_t seed);

/// The part of the unit disc that is nearer to one of some points than to the others.
struct DiscCell {
  math::Vec2d centroid;
  double share = 0;  ///< of the disc's area
};
/// Returns the cells of points of the disc, no two of which are the same.
std::vector<DiscCell> voronoi_cells(const std::vector<math::Vec2d>& points);

}  // namespace kiln::sampling
