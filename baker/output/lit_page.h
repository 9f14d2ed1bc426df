#pragma once

#include <cstdint>
#include <vector>

#include "baker/output/output.h"

namespace kiln::output {

/// MX_lightmap decodes RGBM as E = 34.49 * alpha^2.2 * rgb * intensity, and so do our pages.
inline constexpr float kRgbmRange = 34.49f, kRgbmPower = 2.2f;

/// Returns the irradiance that an sRGB-coded page holds at most: that of the brightest lit texel
/// which is no lamp, or a lower one if that loses less light. A lower scale makes finer codes and
/// clips what is brighter. Of all scales that clip no more than one texel in a thousand this one
/// has the least mean square error of all texels together. Where that error is more than 0.9 % of
/// the mean, it is the brightness that one texel in a thousand exceeds, so that a few do not
/// coarsen the codes of all others. `lamps` are texels whose light nobody sees (hidden_by_lamps()):
/// they count only where nothing else is lit. 1 for a black page.
float lit_scale(const image::PageImage&, const std::vector<bool>& lamps);

/// Encodes a page as lit.glb embeds it, with scale, png and what is clipped. Negative values become
/// 0, and 0 stays 0. Errors: `internal`.
///  - kSrgb8: an opaque image, E = scale * linear value of the sRGB code, with lit_scale(). Codes
///    are rounded to the nearest; dark ones, whose steps are coarse, up or down by an ordered
///    pattern, so that a filtered look-up meets the mean and gradients show no bands.
///  - kRgbm: E = scale * alpha^2.2 * rgb, all of them code / 255; scale is the page's largest
///    channel, so that nothing is clipped.
///  - kNone: no image.
proto::Expected<LitPage> encode_lit_page(const image::PageImage&, const std::vector<bool>& lamps,
                                         proto::GlbLightmap);

/// Encodes what an unlit page shows: sRGB codes of the light by the preview's usual curve at
/// `exposure`. `light`: pi times the radiance that leaves the surface. `alpha`: its first channel
/// is that of the image, which is opaque without. Errors: `internal`.
proto::Expected<LitPage> encode_unlit_page(const image::PageImage& light,
                                           const image::PageImage* alpha, float exposure);

}  // namespace kiln::output
