#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "proto/expected.h"

namespace kiln::baker {

/// PNG bytes of an 8-bit image of 3 (RGB) or 4 (RGBA, straight) channels, row 0 = top. Carries no
/// colour space, so that no reader converts values; the bytes depend on the arguments only.
proto::Expected<std::string> encode_png_bytes(std::span<const std::uint8_t> samples,
                                              std::uint32_t width, std::uint32_t height,
                                              int channels);

}  // namespace kiln::baker
