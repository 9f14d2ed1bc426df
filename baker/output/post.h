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
/// texels (0: the whole page), never writing a lit texel. A padding texel shows the lit texel that
/// is nearest to it, the first in row order among equals; so padding between two charts is parted
/// in the middle. A bilinear look-up inside a chart reads lit texels and their 8 neighbours: with
/// two or more empty texels between charts it never reads another chart's light. `value` is asked
/// for texels of the page. Deterministic; callable from many threads.
using TexelValue = std::function<math::Rgb(std::uint32_t texel)>;
image::PageImage compose_page(const atlas::TextureGroup&, std::uint32_t page,
                              const TexelValue& value, std::uint32_t dilate);

/// Scale that brings the 95th percentile (nearest rank) of lit luminance to 0.8 before the tone
/// curve; the maximum where that percentile is black; 1 for a black page.
float automatic_exposure(const image::PageImage&);

/// sRGB-encoded 8-bit RGB: exposure * value, then x/(1+x) extended so that 4 maps to white.
std::vector<std::array<std::uint8_t, 3>> tone_map(const image::PageImage&, float exposure);

/// Error figures between two images of one size; over texels that are lit (coverage > 0) in both
/// and their three channels; r = reference, d = candidate - r.
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
/// Sums in double precision in row order. Different sizes are a bug of the caller (throws).
CompareResult compare(const image::PageImage& reference, const image::PageImage& candidate);

}  // namespace kiln::output
