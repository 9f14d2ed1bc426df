#include "baker/import/sky_map.h"

#include <cmath>
#include <optional>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/image/image.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr const char* kPointer = "/sky/map";

Unexpected fail(const char* code, const std::string& why) {
  return proto::fail(code, why, "settings", kPointer);
}
Unexpected broken(const std::string& why) {
  return fail("invalid_image", "the sky map can't be used: " + gltf::shortened(why, 200));
}
Unexpected too_large(image::Size size, const char* beside, const char* name, std::uint64_t limit) {
  return fail("limit_exceeded", "a sky map of " + std::to_string(size.width) + " x " +
                                    std::to_string(size.height) + " pixels is too large" + beside +
                                    ": the limit `" + name + "` of this service is " +
                                    std::to_string(limit));
}

struct Opened {
  image::Header header;
  std::optional<image::ColorConversion> to_rec709{};  ///< none: its numbers are that
};

proto::Expected<Opened> open(gltf::Document& document, const std::string& name,
                             const files::ImportLimits& limits) {
  const auto bytes = document.files.named_file(name, "settings", kPointer);
  if (!bytes) return Unexpected(bytes.error());
  const auto format = image::format_of(*bytes);
  if (format != image::Format::kExr && format != image::Format::kHdr &&
      format != image::Format::kTiff)
    return broken("it is neither OpenEXR nor Radiance HDR nor TIFF");
  auto header = image::read_header(*bytes);
  if (!header) return broken(header.error().message);
  if (!header->odd.empty()) return broken(header->odd);
  const image::Size size = header->size;
  if (std::uint64_t(size.width) * size.height > limits.image_pixels)
    return too_large(size, "", "image_pixels", limits.image_pixels);
  if (size.height == 0 || std::uint64_t(size.width) != 2 * std::uint64_t(size.height))
    return broken("it has " + std::to_string(size.width) + " x " + std::to_string(size.height) +
                  " pixels; an equirectangular picture is twice as wide as high");
  if (!header->flaw.empty()) return broken(header->flaw);
  Opened file{std::move(*header)};
  const auto& primaries = file.header.primaries;
  if (primaries && !primaries->is_rec709()) {
    file.to_rec709 = image::ColorConversion::from(*primaries);
    if (!file.to_rec709) return broken("no mixture of the primaries that it names is its white");
  }
  return file;
}

/// Returns why a pixel can't belong to a sky, or null when it can.
const char* fault_of(math::Rgb c) {
  for (const float v : {c.r, c.g, c.b}) {
    if (std::isnan(v)) return "no number";
    if (v > scene::kMaxSkyValue) return "infinite, or as good as that";
    if (std::isinf(v)) return "infinite";
  }
  return nullptr;
}

/// Converts the values to Rec. 709, refuses those that are no radiance, and sets negative ones to
/// 0.
Expected<void> finish_values(scene::SkyMap& map,
                             const std::optional<image::ColorConversion>& to_rec709,
                             gltf::WarningList& warnings, const std::stop_token& stop) {
  std::uint64_t negative = 0;
  for (std::size_t i = 0; i < map.texels.size(); ++i) {
    if (i % map.width == 0 && stop.stop_requested()) return exec::canceled();
    math::Rgb& c = map.texels[i];
    const char* fault = fault_of(c);
    if (!fault && to_rec709) fault = fault_of(c = (*to_rec709)(c));
    if (fault)
      return broken("the pixel (" + std::to_string(i % map.width) + ", " +
                    std::to_string(i / map.width) + ") is " + fault);
    for (float* v : {&c.r, &c.g, &c.b})
      if (*v < 0) ++negative, *v = 0;
  }
  if (negative > 0)
    warnings.add("sky_map_negative", kPointer,
                 "values of the sky map are negative (as linear Rec. 709): they are read as 0",
                 negative);
  return {};
}

}  // namespace

proto::Expected<void> check_sky_map(gltf::Document& document, const std::string& name,
                                    const files::ImportLimits& limits) {
  const auto file = open(document, name, limits);
  if (!file) return Unexpected(file.error());
  return {};
}

proto::Expected<void> load_sky_map(gltf::Document& document, scene::Scene& scene,
                                   const std::string& name, const files::ImportLimits& limits,
                                   const std::stop_token& stop) {
  auto file = open(document, name, limits);
  if (!file) return Unexpected(file.error());
  const image::Size size = file->header.size;
  const std::uint64_t pixels = std::uint64_t(size.width) * size.height;
  if (pixels + scene.image_texels.size() > limits.all_image_pixels)
    return too_large(size, " beside the textures", "all_image_pixels", limits.all_image_pixels);
  scene::SkyMap& map = scene.sky_map;
  map.width = size.width;
  map.height = size.height;
  if (!exec::grow_unless_stopped(map.texels, pixels, stop)) return exec::canceled();
  const auto decoded = image::decode_rgb(file->header, map.texels, {}, stop);
  if (!decoded && decoded.error().code != "invalid_image") return decoded;
  if (!decoded) return broken(decoded.error().message);
  return finish_values(map, file->to_rec709, document.warnings, stop);
}

}  // namespace kiln::import
