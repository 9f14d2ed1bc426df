#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "baker/math/vec.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::image {

/// A page as an image, row-major, row 0 = top.
struct PageImage {
  std::uint32_t width = 0, height = 0;
  std::vector<math::Rgb> rgb;
  std::vector<float> coverage;  ///< > 0 on lit texels only; padding has 0
};

/// Named image layers of one page; the first is written as R,G,B,A, others as name.R, name.G, ...
struct ExrLayer {
  std::string name;
  const PageImage* image = nullptr;
};

/// Writes a tiled, ZIP-compressed OpenEXR file with `metadata` as string attributes. Alpha is 1 on
/// lit texels and 0 in padding. Every value must be finite and, in half precision, <= 65504
/// (checked: `internal`, names the texel). The bytes depend on the arguments only: no dates, no
/// host names. Errors: `io_error`, `canceled`.
proto::Expected<void> write_exr(const std::filesystem::path&, std::span<const ExrLayer>,
                                proto::Precision,
                                std::span<const std::pair<std::string, std::string>> metadata,
                                const std::stop_token& = {});
/// Reads a layer of the first part of any flat OpenEXR file up to 2^27 pixels: `layer`.R, .G, .B,
/// or R, G, B for "" and for the name that `lightkiln:layers` gives them. Coverage is the alpha
/// where that is over one half, else 0 (other bakers write partial coverage as alpha); 1 without
/// alpha. The header is checked before memory is taken. Errors: `canceled`, and `invalid_image`,
/// which for a layer that is missing tells those that there are.
proto::Expected<PageImage> read_exr(const std::filesystem::path&, std::string_view layer = "",
                                    const std::stop_token& = {});

/// Returns the PNG bytes of an 8-bit RGB image.
proto::Expected<std::string> encode_png(std::span<const std::array<std::uint8_t, 3>>,
                                        std::uint32_t width, std::uint32_t height);

}  // namespace kiln::image
