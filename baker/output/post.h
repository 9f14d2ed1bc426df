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

/// Returns the sRGB code of a linear value in 0..1; values outside are clamped, NaN is 0.
std::uint8_t encode_srgb(float linear);

}  // namespace kiln::output
