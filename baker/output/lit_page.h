#pragma once

#include "baker/output/output.h"

namespace kiln::output {

/// Encodes a page as lit.glb embeds it: an opaque 8-bit PNG of linear values, 255 E / scale, where
/// scale is the page's largest channel (1 for a black page), so that nothing is clipped. Values are
/// rounded up or down by an ordered pattern, so that a filtered look-up meets the mean and dark
/// gradients show no bands. Negative values become 0, and 0 stays 0. Errors: `internal`.
proto::Expected<LitPage> encode_lit_page(const image::PageImage&);

}  // namespace kiln::output
