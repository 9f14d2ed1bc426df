#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/math/vec.h"

namespace kiln::baker {

/// A page as an image, row-major, row 0 = top.
struct PageImage {
  std::uint32_t width = 0, height = 0;
  std::vector<Rgb> rgb;
  std::vector<float> coverage;  ///< > 0 on lit texels only; padding has 0
};

/// Lays per-texel values out on a page and fills up to `dilate` texels of padding around each chart
/// (0: the whole page) from the nearest texels, never writing a lit texel. Padding between two
/// charts is shared at the middle, so bilinear look-ups in one chart never read the other's light.
PageImage compose_page(const TextureGroup&, std::uint32_t page, std::span<const Rgb> values,
                       std::uint32_t dilate);

/// Scale that brings the 95th percentile of lit luminance to 0.8 before the tone curve.
/// 1 for a black page.
float automatic_exposure(const PageImage&);

/// sRGB-encoded 8-bit RGB: exposure * value, then x/(1+x) extended so that 4 maps to white.
std::vector<std::array<std::uint8_t, 3>> tone_map(const PageImage&, float exposure);

/// Error figures between two images of one size; lit texels (coverage > 0 in both) only.
struct CompareResult {
  std::uint64_t texels = 0, uncovered = 0;
  double mean_reference = 0, rmse = 0, nrmse = 0, rel_rmse = 0, bias = 0, max_abs = 0, dfpr = 0;
};
CompareResult compare(const PageImage& reference, const PageImage& candidate);

}  // namespace kiln::baker
