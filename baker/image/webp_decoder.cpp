#include <webp/decode.h>

#include <algorithm>
#include <memory>
#include <new>

#include "baker/exec/stop.h"
#include "baker/image/image_decoder.h"

namespace kiln::image {
namespace {

/// So many bytes at a time, a stop request is looked for in between.
constexpr std::size_t kPiece = 64 << 10;

struct Features {
  ImageSize size;
  bool animated = false;
};

/// Of the header; takes no memory.
std::optional<Features> features_of(std::string_view bytes) {
  WebPBitstreamFeatures f;
  const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  if (WebPGetFeatures(data, bytes.size(), &f) != VP8_STATUS_OK || f.width <= 0 || f.height <= 0)
    return std::nullopt;
  return Features{{std::uint32_t(f.width), std::uint32_t(f.height)}, f.has_animation != 0};
}

}  // namespace

bool is_webp(std::string_view bytes) {
  return bytes.size() >= 12 && bytes.starts_with("RIFF") && bytes.substr(8, 4) == "WEBP";
}

std::optional<ImageSize> webp_size(std::string_view bytes) {
  const auto features = features_of(bytes);
  return features ? std::optional(features->size) : std::nullopt;
}

proto::Expected<std::string> decode_webp(std::string_view bytes, ImageSize declared,
                                         ImageTexels texels, const std::stop_token& stop) {
  const auto broken = [](const char* why) { return proto::fail("invalid_image", why); };
  const auto features = features_of(bytes);
  if (!features) return broken("its header can't be read");
  if (features->animated) return broken("it is animated");
  if (features->size.width != declared.width || features->size.height != declared.height)
    return broken("its header appears twice");
  const int stride = int(declared.width) * int(sizeof texels[0]);
  const std::unique_ptr<WebPIDecoder, decltype(&WebPIDelete)> decoder(
      WebPINewRGB(MODE_RGBA, texels.front().data(), texels.size_bytes(), stride), &WebPIDelete);
  if (!decoder) throw std::bad_alloc();
  VP8StatusCode status = VP8_STATUS_SUSPENDED;
  for (std::size_t end = 0; status == VP8_STATUS_SUSPENDED && end < bytes.size();) {
    if (stop.stop_requested()) return exec::canceled();
    end = std::min(end + kPiece, bytes.size());
    // All bytes so far: they stay where they are, and need not be copied.
    status = WebPIUpdate(decoder.get(), reinterpret_cast<const std::uint8_t*>(bytes.data()), end);
  }
  if (status == VP8_STATUS_OK) return "";
  if (status == VP8_STATUS_OUT_OF_MEMORY) throw std::bad_alloc();
  return broken(status == VP8_STATUS_SUSPENDED ? "the file ends too early" : "it is damaged");
}

}  // namespace kiln::image
