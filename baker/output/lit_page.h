#pragma once

#include "baker/output/output.h"

namespace kiln::baker {

/// The page as lit.glb embeds it: an opaque 8-bit PNG of linear values, round(255 E / scale), where
/// scale is the page's largest channel (1 for a black page), so that nothing is clipped. Negative
/// values become 0. Errors: `internal`.
proto::Expected<LitPage> encode_lit_page(const PageImage&);

}  // namespace kiln::baker
