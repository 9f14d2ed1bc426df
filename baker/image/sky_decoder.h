#pragma once

#include <optional>
#include <span>
#include <stop_token>
#include <string_view>

#include "baker/image/image_decoder.h"
#include "baker/image/primaries.h"
#include "baker/math/vec.h"
#include "proto/expected.h"

namespace kiln::image {

/// Pictures whose pixels are radiance, of any brightness. Row 0 = top.
using SkyTexels = std::span<math::Rgb>;

bool is_exr(std::string_view bytes);
bool is_hdr(std::string_view bytes);

/// What a header declares.
struct SkyHeader {
  ImageSize size;
  std::optional<Primaries> primaries;  ///< none: the file doesn't tell, and Rec. 709 is meant
};
/// Take no memory. Refuse what the decoder would refuse by the header alone. Errors:
/// `invalid_image`.
proto::Expected<SkyHeader> exr_header(std::string_view bytes);
proto::Expected<SkyHeader> hdr_header(std::string_view bytes);

/// Refuse, besides, sizes for which the file is too short, so that a decoder takes no more memory
/// than a multiple of the picture's size. Errors: `invalid_image`.
proto::Expected<void> check_exr_length(std::string_view bytes);
proto::Expected<void> check_hdr_length(std::string_view bytes);

/// Fill `texels`, which has one entry per pixel of the declared size, with the file's numbers,
/// whatever they are, by its own primaries. OpenEXR: one part, scan lines or tiles, any
/// compression, channels R, G and B as half or float. Radiance: RGBE, its EXPOSURE taken out again.
/// Safe to call from many threads. Errors: `invalid_image` with the reason, `canceled`. Throw
/// std::bad_alloc when there is too little memory, also where the library makes another error of
/// that.
proto::Expected<void> decode_exr(std::string_view bytes, ImageSize declared, SkyTexels texels,
                                 const std::stop_token&);
proto::Expected<void> decode_hdr(std::string_view bytes, ImageSize declared, SkyTexels texels,
                                 const std::stop_token&);

}  // namespace kiln::image
