#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "baker/exec/workers.h"
#include "baker/math/vec.h"
#include "baker/scene/scene.h"

namespace kiln::light {

/// A sky that a map gives: what it is by direction, and directions towards its bright parts.
///
/// Cosine-distributed directions find a sky that varies slowly, and miss the sun; directions drawn
/// from the map find the sun. Both are taken, each weighted by the balance heuristic [Veach and
/// Guibas, "Optimally Combining Sampling Techniques", SIGGRAPH 1995]. Since the former cover the
/// whole sky, the latter need only go where it is brighter than its mean: their density is that
/// excess [Karlik et al., "MIS Compensation", SIGGRAPH Asia 2019]. Immutable.
class SkyLight {
 public:
  /// The table of a map of 2^28 pixels takes seconds: rows are summed by the workers (by the
  /// calling thread where there are none), with the same result on any number of threads. When they
  /// are stopped, this is of no use.
  /// @param scene has a sky map; outlives this
  explicit SkyLight(const scene::Scene& scene, const exec::Workers* workers = nullptr);

  struct Seen {
    math::Rgb radiance;  ///< cd/m2, the uniform sky included
    float density = 0;   ///< of sample(), per steradian
  };
  Seen seen(math::Vec3 direction) const;

  /// False where nothing stands out: there are no directions to draw then.
  bool has_bright_parts() const { return !row_ends_.empty(); }
  struct Sample {
    math::Vec3 direction;  ///< unit
    Seen seen;
  };
  /// By the uniform pair `u`. Within a pixel, uniform in solid angle.
  Sample sample(math::Vec2 u) const;

 private:
  /// The luminance above the floor.
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

/// How many of all directions are drawn from the bright parts of the sky, and how many by cosine.
/// Weights of both, for a direction with these densities.
class SkyShares {
 public:
  SkyShares(float bright, float cosine)
      : bright_(bright / (bright + cosine)), cosine_(cosine / (bright + cosine)) {}

  /// Weight over the density, of one that was drawn from the bright parts.
  float of_bright(float density, float cosine) const { return bright_ / both(density, cosine); }
  /// Weight of one that was drawn by cosine.
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
