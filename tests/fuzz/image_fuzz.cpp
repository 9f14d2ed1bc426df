// A picture of any format: its header, and its pixels by the image module.
#include <cstdint>
#include <cstdlib>

#include "baker/image/image.h"
#include "tests/fuzz/require.h"

using namespace kiln;

namespace {

constexpr std::uint64_t kMaxPixels = 1 << 16;

bool is_texture(image::Format format) {
  return format == image::Format::kPng || format == image::Format::kJpeg ||
         format == image::Format::kWebp;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  FUZZ_REQUIRE(image::open_module());
  const auto format = image::format_of(bytes);
  if (!format) return 0;
  auto header = image::read_header(bytes);
  if (!header) {
    FUZZ_REQUIRE(header.error().code == "invalid_image");
    return 0;
  }
  const std::uint64_t pixels = std::uint64_t(header->size.width) * header->size.height;
  if (pixels == 0 || pixels > kMaxPixels) return 0;
  if (is_texture(*format)) {
    std::vector<std::array<std::uint8_t, 4>> texels(pixels);
    const auto damage = image::decode_rgba8(*header, texels, {});
    FUZZ_REQUIRE(damage || damage.error().code == "invalid_image");
  } else {
    std::vector<math::Rgb> rgb(pixels);
    std::vector<float> alpha(pixels);
    const auto decoded = image::decode_rgb(*header, rgb, alpha, {});
    FUZZ_REQUIRE(decoded || decoded.error().code == "invalid_image");
  }
  return 0;
}
