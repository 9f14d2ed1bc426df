#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::image {

struct ImageSize {
  std::uint32_t width = 0, height = 0;
};

/// RGBA, 8 bits each, row 0 = top.
using ImageTexels = std::span<std::array<std::uint8_t, 4>>;

bool is_png(std::string_view bytes);
bool is_jpeg(std::string_view bytes);
bool is_webp(std::string_view bytes);

/// Size that the header declares, nothing when there is none to be found. Takes no memory.
std::optional<ImageSize> png_size(std::string_view bytes);
std::optional<ImageSize> jpeg_size(std::string_view bytes);
std::optional<ImageSize> webp_size(std::string_view bytes);

/// Fill `texels`, which has one entry per pixel of the declared size. Grey becomes RGB; palettes
/// become colours; 16 bits per channel are rounded to 8; colours are neither converted nor
/// multiplied by alpha, which is 255 where the image has none. Safe to call from many threads.
/// Returns what is damaged in an image of which only a part could be read, "" for a whole one.
/// Errors: `invalid_image` with the library's reason, `canceled`.
proto::Expected<std::string> decode_png(std::string_view bytes, ImageSize declared,
                                        ImageTexels texels, const std::stop_token&);
proto::Expected<std::string> decode_jpeg(std::string_view bytes, ImageSize declared,
                                         ImageTexels texels, const std::stop_token&);
proto::Expected<std::string> decode_webp(std::string_view bytes, ImageSize declared,
                                         ImageTexels texels, const std::stop_token&);

}  // namespace kiln::image
