#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/denoise/surface_neighbors.h"
#include "baker/exec/workers.h"
#include "baker/lightmap/lightmap.h"

namespace kiln::denoise {

/// A lightmap as it is written, and how well it is known. One entry per texel.
struct FilteredLight {
  lightmap::Plane<math::Rgb> direct, sky, indirect;  ///< lx
  /// The variance of the luminance, lx²: of direct light, and of sky and indirect light together.
  lightmap::Plane<float> direct_variance, gathered_variance;
};

/// Smooths light where that lowers its error, and estimates the error that is left. Direct light is
/// one signal, sky and indirect light together another.
///
/// Several filters smooth both halves of the samples. Each half is a reference for the filtered
/// other half whose own error is independent of it, so the error of every filter, bias and noise,
/// is known without knowing the light: e = (|F(A)-B|² + |F(B)-A|²)/2 - |A-B|²/2 - |F(A)-F(B)|²/4,
/// averaged over the texels around [cross-validation: Rousselle et al., "Adaptive Rendering with
/// Non-Local Means Filtering", 2012, sec. 4].
///
/// The result is their mean with weights that fall with the square of that error, so it goes over
/// to the unfiltered light as samples rise. Filters reach over texels of the same surface only, as
/// SurfaceNeighbors has them.
///
/// The same light gives the same bits, on any number of threads.
class FilterBank {
 public:
  /// @param smooth false: the light stays as it is, and its variance is the mean of its squared
  /// half difference over the texels around
  /// @param sky its radiance, the same in every direction
  /// @param has_sky_map the sky has its own color on every texel
  FilterBank(const atlas::TextureGroup& texels, math::Rgb sky, bool smooth,
             bool has_sky_map = false)
      : texels_(texels),
        neighbors_(texels),
        sky_(sky),
        smooth_(smooth),
        has_sky_map_(has_sky_map) {}

  /// Returns nothing when stopped.
  std::optional<FilteredLight> run(const lightmap::Lightmap&, const exec::Workers&);

 private:
  const atlas::TextureGroup& texels_;
  SurfaceNeighbors neighbors_;
  math::Rgb sky_;
  bool smooth_, has_sky_map_, linked_ = false;
};

}  // namespace kiln::denoise
