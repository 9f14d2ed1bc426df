#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "baker/exec/workers.h"
#include "baker/math/vec.h"
#include "baker/scene/scene.h"

namespace kiln::light {

/// Gives the sky of a map by direction, and samples directions towards its bright parts.
///
/// Cosine-distributed directions find a sky that varies slowly, and miss the sun; directions drawn
/// from the map find the sun. Both are taken, each weighted by the balance heuristic [Veach and
/// Guibas, "Optimally Combining Sampling Techniques", SIGGRAPH 1995].
///
/// Since the former cover the whole sky, the latter need only go where it is brighter than its
/// mean: their density is that excess [Karlik et al., "MIS Compensation", SIGGRAPH Asia 2019].
/// Immutable.
class SkyLight {
 public:
  /// Builds the table, which takes seconds for a map of 2^28 pixels. The workers sum the rows (the
  /// calling thread does when there are none), with the same result on any number of threads. When
  /// they are stopped, the object must not be used.
  /// @param scene has a sky map; outlives this
  explicit SkyLight(const scene::Scene& scene, const exec::Workers* workers = nullptr);

  struct Seen {
    math::Rgb radiance;  ///< cd/m2, the uniform sky included
    float density = 0;   ///< density of sample(), per steradian
  };
  Seen seen(math::Vec3 direction) const;

  /// Returns false when no part of the sky stands out: there are no directions to draw then.
  bool has_bright_parts() const { return !row_ends_.empty(); }
  struct Sample {
    math::Vec3 direction;  ///< unit
    Seen seen;
  };
  /// Samples a direction by the uniform pair `u`. Within a pixel it is uniform in solid angle.
  Sample sample(math::Vec2 u) const;

 private:
  /// Returns the luminance above the floor.
  float excess(std::size_t pixel) const {
    return std::max(0.f, luminance(map_.texels[pixel]) - floor_);
  }
  Seen seen(std::size_t pixel) const;

  const math::Rgb uniform_;
  const scene::SkyMap& map_;
  const std::vector<double> edge_cosines_;  ///< cosθ at the edges of the rows
  float floor_ = 0;                         ///< luminance of a map value above which it is bright
  float per_excess_ = 0;                    ///< density over luminance above the floor
  /// Sums of the probabilities of the rows, and of the pixels of each row, up to their ends.
  std::vector<float> row_ends_, pixel_ends_;
};

/// Weighs directions that are drawn from the bright parts of the sky against those drawn by cosine,
/// given the number of each.
class SkyShares {
 public:
  SkyShares(float bright, float cosine)
      : bright_(bright / (bright + cosine)), cosine_(cosine / (bright + cosine)) {}

  /// Returns the weight over the density of a direction that was drawn from the bright parts.
  float of_bright(float density, float cosine) const { return bright_ / both(density, cosine); }
  /// Returns the weight of a direction that was drawn by cosine.
  float of_cosine(float density, float cosine) const {
    return density > 0 ? cosine_ * (cosine / math::kPi) / both(density, cosine) : 1.f;
  }

 private:
  float both(float density, float cosine) const {
    return bright_ * density + cosine_ * (cosine / math::kPi);
  }
  float bright_, cosine_;
};

}  // namespace kiln::light
