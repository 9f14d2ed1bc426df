#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <stop_token>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/image/page_image.h"
#include "baker/math/vec.h"

namespace kiln::output {

/// Lays per-texel values out on a page and fills up to `dilate` rings of padding around the lit
/// texels (0: the whole page). It never overwrites a lit texel. A padding texel shows the lit texel
/// that is nearest to it, the first in row order among equals, so padding between two charts is
/// divided in the middle. A bilinear look-up inside a chart reads lit texels and their 8 neighbors:
/// with two or more empty texels between charts it never reads another chart's light. `value` is
/// called for texels of the page. Deterministic; callable from many threads.
using TexelValue = std::function<math::Rgb(std::uint32_t texel)>;
image::PageImage compose_page(const atlas::TextureGroup&, std::uint32_t page,
                              const TexelValue& value, std::uint32_t dilate);

/// Returns the scale that brings the 95th percentile (nearest rank) of lit luminance to 0.8 before
/// the tone curve. Where that percentile is black it brings the maximum there. A black page gets 1.
float automatic_exposure(const image::PageImage&);

/// Returns sRGB-encoded 8-bit RGB of exposure * value, mapped by x/(1+x), extended so that 4 maps
/// to white.
std::vector<std::array<std::uint8_t, 3>> tone_map(const image::PageImage&, float exposure);

/// Error figures between two images of one size. They cover the three channels of all texels that
/// are lit (coverage > 0) in both images; r = reference, d = candidate - r.
struct CompareResult {
  std::uint64_t texels = 0;     ///< lit in both
  std::uint64_t uncovered = 0;  ///< lit in the reference only
  std::uint64_t nonfinite = 0;  ///< candidate texels with a NaN or an infinity: such a channel is 0
  double mean_reference = 0;    ///< mean r
  double rmse = 0;              ///< sqrt(mean d^2)
  double nrmse = 0;             ///< rmse / mean r; 0 where mean r is 0
  double rel_rmse = 0;          ///< sqrt(mean (d / (r + 0.02 mean r))^2): weights dark texels
  double bias = 0;              ///< mean d / mean r; 0 where mean r is 0
  double max_abs = 0;           ///< max |d|
  double dfpr = 0;              ///< mean Euclidean RGB distance per texel [RTRad eq. 6.1]
};
/// Compares two images. It sums in double precision, in row order. It throws when the sizes differ,
/// which is a bug of the caller.
CompareResult compare(const image::PageImage& reference, const image::PageImage& candidate);

}  // namespace kiln::output
