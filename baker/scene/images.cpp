#include "baker/scene/images.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <optional>
#include <set>

#include "baker/scene/errors.h"
#include "baker/scene/gltf_json.h"
#include "baker/scene/uri.h"

namespace kiln::baker {
namespace {

using proto::Expected;
using proto::Unexpected;

std::string image_pointer(std::int32_t image) {
  return pointer_to("/images", static_cast<std::size_t>(image));
}

Unexpected broken(const std::string& why, std::int32_t image) {
  return proto::fail("invalid_image", why, "scene", image_pointer(image));
}

/// Encoded bytes of an image. Data URIs are decoded into document.decoded.
Expected<std::string_view> image_bytes(Document& document, std::int32_t image) {
  const ImageSource& source = document.images[static_cast<std::size_t>(image)];
  const std::string at = image_pointer(image);
  if (source.buffer_view >= 0)
    return buffer_view_bytes(document, source.buffer_view, at + "/bufferView");
  if (source.uri.empty()) return broken("has neither a uri nor a bufferView", image);
  if (!is_data_uri(source.uri)) return document.files.side_file(source.uri, at + "/uri");
  auto data = decode_data_uri(source.uri, at + "/uri");
  if (!data) {
    data.error().code = "invalid_image";
    return Unexpected(data.error());
  }
  document.decoded.push_back(std::make_unique<std::string>(std::move(data->bytes)));
  return *document.decoded.back();
}

/// The library's name of the format, by which it picks its reader; "" for formats that are left
/// out.
const char* format_name(std::string_view bytes) {
  if (bytes.starts_with("\x89PNG\r\n\x1a\n")) return "png";
  if (bytes.starts_with("\xff\xd8\xff")) return "jpeg";
  return "";
}

struct ImageSize {
  std::uint32_t width = 0, height = 0;
};

std::uint32_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i)
    value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
  return value;
}

/// Frame size of a JPEG, from its first SOF marker [ITU T.81, B.2.2]. Bytes between segments are
/// skipped as libjpeg does, so that both find the same marker.
std::optional<ImageSize> jpeg_size(std::string_view bytes) {
  for (std::size_t at = 2; at + 9 <= bytes.size();) {
    const auto byte = static_cast<unsigned char>(bytes[at]);
    const auto marker = static_cast<unsigned char>(bytes[at + 1]);
    if (byte != 0xff || marker == 0 || marker == 0xff) {
      ++at;
      continue;
    }
    at += 2;
    if (marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8)) continue;  // no segment follows
    const bool is_frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (is_frame) return ImageSize{big_endian(bytes, at + 5, 2), big_endian(bytes, at + 3, 2)};
    if (marker == 0xd9 || marker == 0xda) return std::nullopt;
    at += std::max(2u, big_endian(bytes, at, 2));
  }
  return std::nullopt;
}

/// Size that the header declares. Read here, because the library may take memory for the whole
/// image when it opens it.
std::optional<ImageSize> declared_size(std::string_view bytes) {
  if (format_name(bytes) != std::string_view("png")) return jpeg_size(bytes);
  if (bytes.size() < 24 || bytes.substr(12, 4) != "IHDR") return std::nullopt;
  return ImageSize{big_endian(bytes, 16, 4), big_endian(bytes, 20, 4)};
}

std::set<std::int32_t> used_images(const std::vector<Material>& materials) {
  std::set<std::int32_t> used;
  for (const Material& m : materials) {
    used.insert(m.base_texture.image);
    if (!is_black(m.emission)) used.insert(m.emission_texture.image);
  }
  used.erase(-1);
  return used;
}

/// Grey, grey + alpha, RGB or RGBA to RGBA.
void spread_channels(const std::vector<std::uint8_t>& from, int channels,
                     std::array<std::uint8_t, 4>* to, std::size_t pixels) {
  const auto n = static_cast<std::size_t>(channels);
  const bool is_grey = channels < 3, has_alpha = channels == 2 || channels >= 4;
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint8_t* p = &from[i * n];
    to[i] = {p[0], p[is_grey ? 0 : 1], p[is_grey ? 0 : 2],
             has_alpha ? p[is_grey ? 1 : 3] : std::uint8_t(255)};
  }
}

class Decoder {
 public:
  Decoder(Scene& scene, const ImportLimits& limits, const std::stop_token& stop)
      : scene_(scene), limits_(limits), stop_(stop), pixels_left_(limits.all_image_pixels) {}

  /// Appends one image to the scene.
  Expected<void> decode(std::string_view bytes, std::int32_t image) {
    const auto declared = declared_size(bytes);
    if (!declared) return broken("the image's header can't be read", image);
    if (auto fits = check_size(*declared, image); !fits) return fits;
    OIIO::Filesystem::IOMemReader memory(bytes.data(), bytes.size());
    OIIO::ImageSpec config, spec;
    config.attribute("oiio:UnassociatedAlpha", 1);  // colours as stored, not multiplied by alpha
    const auto input = OIIO::ImageInput::create(format_name(bytes));
    if (!input) return broken(reason(OIIO::geterror()), image);
    // The name is only for messages: the reader sees nothing but these bytes.
    if (!input->set_ioproxy(&memory) || !input->open(format_name(bytes), spec, config)) {
      return broken(reason(input->geterror()), image);
    }
    if (spec.width != static_cast<int>(declared->width) ||
        spec.height != static_cast<int>(declared->height) || spec.nchannels < 1 ||
        spec.nchannels > 4) {
      return broken("expected a flat image of 1 to 4 channels, of the size in its header", image);
    }
    input->threads(1);
    return read_rows(*input, image);
  }

 private:
  static std::string reason(const std::string& library_says) {
    return "the image can't be decoded: " + shortened(library_says, 200);
  }

  Expected<void> check_size(ImageSize size, std::int32_t image) {
    if (size.width == 0 || size.height == 0) return broken("the image is empty", image);
    const std::uint64_t pixels = std::uint64_t(size.width) * size.height;
    if (pixels > limits_.image_pixels || pixels > pixels_left_) {
      return proto::fail("limit_exceeded",
                         "an image of " + std::to_string(size.width) + " x " +
                             std::to_string(size.height) + " pixels is too large",
                         "scene", image_pointer(image));
    }
    pixels_left_ -= pixels;
    return {};
  }

  /// In bands, so that a stop request is seen in time.
  Expected<void> read_rows(OIIO::ImageInput& input, std::int32_t image) {
    const int width = input.spec().width, height = input.spec().height;
    const int channels = input.spec().nchannels;
    const Image out{static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height),
                    scene_.image_texels.size()};
    scene_.image_texels.resize(out.first_texel + std::uint64_t(out.width) * out.height);
    const int band = std::max(1, (1 << 20) / width);
    std::vector<std::uint8_t> rows;
    for (int y = 0; y < height; y += band) {
      if (stop_.stop_requested()) return canceled();
      const int end = std::min(y + band, height);
      const std::size_t pixels = std::size_t(out.width) * static_cast<std::size_t>(end - y);
      rows.resize(pixels * static_cast<std::size_t>(channels));
      if (!input.read_scanlines(0, 0, y, end, 0, 0, channels, OIIO::TypeDesc::UINT8, rows.data())) {
        return broken(reason(input.geterror()), image);
      }
      spread_channels(
          rows, channels,
          &scene_.image_texels[out.first_texel + std::uint64_t(out.width) * std::uint64_t(y)],
          pixels);
    }
    scene_.images.push_back(out);
    return {};
  }

  Scene& scene_;
  const ImportLimits& limits_;
  const std::stop_token& stop_;
  std::uint64_t pixels_left_;
};

}  // namespace

Expected<void> load_images(Document& document, Scene& scene, const ImportLimits& limits,
                           const std::stop_token& stop) {
  Decoder decoder(scene, limits, stop);
  std::vector<std::int32_t> place(document.images.size(), -1);
  for (const std::int32_t image : used_images(scene.materials)) {
    const auto bytes = image_bytes(document, image);
    if (!bytes) return Unexpected(bytes.error());
    if (*format_name(*bytes) == '\0') {
      document.warnings.add("image_ignored", image_pointer(image),
                            "the image is neither PNG nor JPEG: the factor alone is used");
      continue;
    }
    if (auto decoded = decoder.decode(*bytes, image); !decoded) return decoded;
    place[static_cast<std::size_t>(image)] = static_cast<std::int32_t>(scene.images.size()) - 1;
  }
  const auto rename = [&](Texture& texture) {
    if (texture.image >= 0) texture.image = place[static_cast<std::size_t>(texture.image)];
  };
  for (Material& material : scene.materials) {
    rename(material.base_texture);
    rename(material.emission_texture);
  }
  return {};
}

Expected<void> find_images(Document& document, const std::vector<Material>& materials) {
  for (const std::int32_t image : used_images(materials)) {
    const ImageSource& source = document.images[static_cast<std::size_t>(image)];
    if (source.buffer_view >= 0 || source.uri.empty() || is_data_uri(source.uri)) continue;
    const auto found = document.files.find(source.uri, image_pointer(image) + "/uri");
    if (!found) return Unexpected(found.error());
  }
  return {};
}

}  // namespace kiln::baker
