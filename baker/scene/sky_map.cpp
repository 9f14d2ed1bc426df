#include "baker/scene/sky_map.h"

#include <cmath>

#include "baker/scene/errors.h"
#include "baker/scene/gltf_json.h"
#include "baker/scene/sky_decoder.h"

namespace kiln::baker {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr const char* kPointer = "/sky/map";

Unexpected fail(const char* code, const std::string& why) {
  return proto::fail(code, why, "settings", kPointer);
}
Unexpected broken(const std::string& why) {
  return fail("invalid_image", "the sky map can't be used: " + shortened(why, 200));
}
Unexpected too_large(ImageSize size, const char* beside, const char* name, std::uint64_t limit) {
  return fail("limit_exceeded", "a sky map of " + std::to_string(size.width) + " x " +
                                    std::to_string(size.height) + " pixels is too large" + beside +
                                    ": the limit `" + name + "` of this service is " +
                                    std::to_string(limit));
}

struct Opened {
  std::string_view bytes;
  ImageSize size;
  bool exr = false;
};

Expected<Opened> open(Document& document, const std::string& name, const ImportLimits& limits) {
  const auto bytes = document.files.named_file(name, "settings", kPointer);
  if (!bytes) return Unexpected(bytes.error());
  Opened file{*bytes, {}, is_exr(*bytes)};
  if (!file.exr && !is_hdr(*bytes)) return broken("it is neither OpenEXR nor Radiance HDR");
  const auto size = file.exr ? exr_size(*bytes) : hdr_size(*bytes);
  if (!size) return broken(size.error().message);
  file.size = *size;
  if (size->height == 0 || std::uint64_t(size->width) != 2 * std::uint64_t(size->height))
    return broken("it has " + std::to_string(size->width) + " x " + std::to_string(size->height) +
                  " pixels; an equirectangular picture is twice as wide as high");
  if (std::uint64_t(size->width) * size->height > limits.image_pixels)
    return too_large(*size, "", "image_pixels", limits.image_pixels);
  return file;
}

/// Makes the values such as SkyMap has them.
Expected<void> check_values(SkyMap& map, WarningList& warnings) {
  std::uint64_t negative = 0;
  for (std::size_t i = 0; i < map.texels.size(); ++i) {
    Rgb& c = map.texels[i];
    const char* wrong = nullptr;
    for (float* v : {&c.r, &c.g, &c.b}) {
      if (std::isnan(*v)) wrong = "no number";
      if (*v > kMaxSkyValue) wrong = "infinite, or as good as that";
      if (!(*v < 0)) continue;
      if (std::isinf(*v)) wrong = "infinite";
      ++negative, *v = 0;
    }
    if (wrong)
      return broken("the pixel (" + std::to_string(i % map.width) + ", " +
                    std::to_string(i / map.width) + ") is " + wrong);
  }
  if (negative > 0)
    warnings.add("sky_map_negative", kPointer,
                 "values of the sky map are negative: they are read as 0", negative);
  return {};
}

}  // namespace

Expected<void> check_sky_map(Document& document, const std::string& name,
                             const ImportLimits& limits) {
  const auto file = open(document, name, limits);
  if (!file) return Unexpected(file.error());
  return {};
}

Expected<void> load_sky_map(Document& document, Scene& scene, const std::string& name,
                            const ImportLimits& limits, const std::stop_token& stop) {
  const auto file = open(document, name, limits);
  if (!file) return Unexpected(file.error());
  const std::uint64_t pixels = std::uint64_t(file->size.width) * file->size.height;
  if (pixels + scene.image_texels.size() > limits.all_image_pixels)
    return too_large(file->size, " beside the textures", "all_image_pixels",
                     limits.all_image_pixels);
  SkyMap& map = scene.sky_map;
  map.width = file->size.width;
  map.height = file->size.height;
  map.texels.resize(pixels);
  const auto decoded =
      (file->exr ? decode_exr : decode_hdr)(file->bytes, file->size, map.texels, stop);
  if (!decoded && decoded.error().code == proto::kCanceledCode) return decoded;
  if (!decoded) return broken(decoded.error().message);
  return check_values(map, document.warnings);
}

}  // namespace kiln::baker
