#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
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
/// Returns the same for the luminance of lit texels, in any order.
float automatic_exposure(std::vector<float> luminance);

/// The way from light to 8-bit colors.
struct Tone {
  float exposure = 1;  ///< x = exposure * value
  /// Null: the sRGB code of x (1 + x/16) / (1 + x), which maps 4 to white. Otherwise the code
  /// 255 x / (k + x) [Moreno-Fortuny 4.4.2], which maps 1 to 1 / (1 + k).
  std::optional<float> k = {};
};

/// Returns the tone of an image: an exposure that is given; or the curve k, at an exposure that
/// takes the brightest channel of all lit texels to 1 (a black image: at 1); or an automatic
/// exposure.
Tone tone_of(const image::PageImage&, std::optional<float> exposure, std::optional<float> k);

std::vector<std::array<std::uint8_t, 3>> tone_map(const image::PageImage&, Tone);

/// Returns the sRGB code of a linear value in 0..1; values outside are clamped, NaN is 0.
std::uint8_t encode_srgb(float linear);
/// Returns 255 v, rounded; values outside of 0..1 are clamped, NaN is 0.
std::uint8_t plain_code(float v);

}  // namespace kiln::output
