#pragma once

#include <span>
#include <stop_token>
#include <string_view>

#include "baker/math/vec.h"
#include "baker/scene/image_decoder.h"
#include "proto/expected.h"

namespace kiln::baker {

/// Pictures whose pixels are radiance: linear Rec. 709, of any brightness. Row 0 = top.
using SkyTexels = std::span<Rgb>;

bool is_exr(std::string_view bytes);
bool is_hdr(std::string_view bytes);

/// Size that the header declares. Takes no memory. Refuses what the decoder would refuse by the
/// header alone, and sizes for which the file is too short, so that a decoder takes no more memory
/// than a multiple of the picture's size. Errors: `invalid_image`.
proto::Expected<ImageSize> exr_size(std::string_view bytes);
proto::Expected<ImageSize> hdr_size(std::string_view bytes);

/// Fill `texels`, which has one entry per pixel of the declared size, with the file's numbers,
/// whatever they are. OpenEXR: one part, scan lines or tiles, any compression, channels R, G and B
/// as half or float. Radiance: RGBE, its EXPOSURE taken out again. Safe to call from many threads.
/// Errors: `invalid_image` with the reason, `canceled`.
proto::Expected<void> decode_exr(std::string_view bytes, ImageSize declared, SkyTexels texels,
                                 const std::stop_token&);
proto::Expected<void> decode_hdr(std::string_view bytes, ImageSize declared, SkyTexels texels,
                                 const std::stop_token&);

}  // namespace kiln::baker
