#include "baker/import/images.h"

#include <set>

#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/uri.h"
#include "baker/image/image.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;

std::string image_pointer(std::int32_t image) {
  return gltf::pointer_to("/images", static_cast<std::size_t>(image));
}

Unexpected broken(const std::string& why, std::int32_t image) {
  return proto::fail("invalid_image", why, "scene", image_pointer(image));
}

/// Encoded bytes of an image. Data URIs are decoded into document.decoded.
Expected<std::string_view> image_bytes(gltf::Document& document, std::int32_t image) {
  const gltf::ImageSource& source = document.images[static_cast<std::size_t>(image)];
  const std::string at = image_pointer(image);
  if (source.buffer_view >= 0)
    return buffer_view_bytes(document, source.buffer_view, at + "/bufferView");
  if (source.uri.empty()) return broken("has neither a uri nor a bufferView", image);
  if (!gltf::is_data_uri(source.uri)) return document.files.side_file(source.uri, at + "/uri");
  auto data = gltf::decode_data_uri(source.uri, at + "/uri");
  if (!data) {
    data.error().code = "invalid_image";
    return Unexpected(data.error());
  }
  document.decoded.push_back(std::make_unique<std::string>(std::move(data->bytes)));
  return *document.decoded.back();
}

std::set<std::int32_t> used_images(const std::vector<scene::Material>& materials) {
  std::set<std::int32_t> used;
  for (const scene::Material& m : materials) {
    used.insert(m.base_texture.image);
    if (!is_black(m.emission)) used.insert(m.emission_texture.image);
  }
  used.erase(-1);
  return used;
}

/// Textures have these formats; others are for skies.
bool is_texture(std::string_view bytes) {
  const auto format = image::format_of(bytes);
  return format == image::Format::kPng || format == image::Format::kJpeg ||
         format == image::Format::kWebp;
}

class Decoder {
 public:
  Decoder(gltf::Document& document, scene::Scene& scene, const files::ImportLimits& limits,
          const std::stop_token& stop)
      : document_(document),
        scene_(scene),
        limits_(limits),
        stop_(stop),
        pixels_left_(limits.all_image_pixels) {}

  /// Appends one image to the scene.
  Expected<void> decode(std::string_view bytes, std::int32_t image) {
    const auto header = image::read_header(bytes);
    if (!header) return broken("the image's header can't be read", image);
    // This comes first, because the library may take memory for the whole image when it opens it.
    const image::Size size = header->size;
    if (auto fits = check_size(size, image); !fits) return fits;
    const std::size_t first = scene_.image_texels.size();
    scene_.image_texels.resize(first + std::size_t(size.width) * size.height);
    const image::Texels texels = image::Texels(scene_.image_texels).subspan(first);
    const auto damage = image::decode_rgba8(*header, texels, stop_);
    if (!damage && damage.error().code != "invalid_image") return Unexpected(damage.error());
    if (!damage)
      return broken("the image can't be decoded: " + gltf::shortened(damage.error().message, 200),
                    image);
    if (!damage->empty())
      document_.warnings.add("image_damaged", image_pointer(image),
                             "the image is damaged, a part of it is guessed: " + *damage);
    scene_.images.push_back({size.width, size.height, first});
    return {};
  }

 private:
  Expected<void> check_size(image::Size size, std::int32_t image) {
    if (size.width == 0 || size.height == 0) return broken("the image is empty", image);
    const std::uint64_t pixels = std::uint64_t(size.width) * size.height;
    const std::string what = "an image of " + std::to_string(size.width) + " x " +
                             std::to_string(size.height) + " pixels is too large";
    if (pixels > limits_.image_pixels)
      return gltf::over_limit(what, limits_.image_pixels, "image_pixels", image_pointer(image));
    if (pixels > pixels_left_)
      return gltf::over_limit(what + " beside the others", limits_.all_image_pixels,
                              "all_image_pixels", image_pointer(image));
    pixels_left_ -= pixels;
    return {};
  }

  gltf::Document& document_;
  scene::Scene& scene_;
  const files::ImportLimits& limits_;
  const std::stop_token& stop_;
  std::uint64_t pixels_left_;
};

}  // namespace

proto::Expected<void> load_images(gltf::Document& document, scene::Scene& scene,
                                  const files::ImportLimits& limits, const std::stop_token& stop) {
  Decoder decoder(document, scene, limits, stop);
  std::vector<std::int32_t> place(document.images.size(), -1);
  for (const std::int32_t image : used_images(scene.materials)) {
    const auto bytes = image_bytes(document, image);
    if (!bytes) return Unexpected(bytes.error());
    if (!is_texture(*bytes)) {
      document.warnings.add("image_ignored", image_pointer(image),
                            "the image is neither PNG, JPEG nor WebP: the factor alone is used");
      continue;
    }
    if (auto decoded = decoder.decode(*bytes, image); !decoded) return decoded;
    place[static_cast<std::size_t>(image)] = static_cast<std::int32_t>(scene.images.size()) - 1;
  }
  const auto rename = [&](scene::Texture& texture) {
    if (texture.image >= 0) texture.image = place[static_cast<std::size_t>(texture.image)];
  };
  for (scene::Material& material : scene.materials) {
    rename(material.base_texture);
    rename(material.emission_texture);
  }
  return {};
}

proto::Expected<void> find_images(gltf::Document& document,
                                  const std::vector<scene::Material>& materials) {
  for (const std::int32_t image : used_images(materials)) {
    const gltf::ImageSource& source = document.images[static_cast<std::size_t>(image)];
    if (source.buffer_view >= 0 || source.uri.empty() || gltf::is_data_uri(source.uri)) continue;
    const auto found = document.files.find(source.uri, image_pointer(image) + "/uri");
    if (!found) return Unexpected(found.error());
  }
  return {};
}

}  // namespace kiln::import
