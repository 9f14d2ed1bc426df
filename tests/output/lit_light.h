#pragma once

#include <cmath>
#include <stdexcept>
#include <vector>

#include "baker/image/image.h"
#include "baker/math/vec.h"
#include "tests/output/gltf_file.h"

namespace kiln::output {

/// The pixels of a PNG.
struct Picture8 {
  std::uint32_t width = 0, height = 0;
  std::vector<std::array<std::uint8_t, 4>> rgba;
};

inline Picture8 decode_picture(const std::string& png) {
  const auto header = image::read_header(png);
  if (!header) throw std::runtime_error("not a PNG: " + header.error().message);
  Picture8 out{header->size.width, header->size.height, {}};
  out.rgba.resize(std::size_t(out.width) * out.height);
  const auto flaw = image::decode_rgba8(*header, out.rgba, {});
  if (!flaw || !flaw->empty()) throw std::runtime_error("broken PNG");
  return out;
}

/// Returns the picture of a page in lit.glb.
inline Picture8 page_picture(const GlbReader& lit, int page) {
  const Json& told = lit.json["asset"]["extras"]["lightkiln"]["pages"][page];
  const Json& texture = lit.json["textures"][told["texture"].get<int>()];
  return decode_picture(
      lit.view(lit.json["images"][texture["source"].get<int>()]["bufferView"].get<int>()));
}

inline double linear_of(std::uint8_t code) {
  const double c = code / 255.0;
  return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
}

/// Returns the irradiance of a page by the formula that docs/lit-scenes.md states.
inline std::vector<math::Rgb> page_light(const GlbReader& lit, int page) {
  const Json& told = lit.json["asset"]["extras"]["lightkiln"];
  const double scale = told["pages"][page]["scale"];
  const bool rgbm = told["encoding"] == "rgbm";
  if (!rgbm && told["encoding"] != "srgb8") throw std::runtime_error("unknown encoding");
  std::vector<math::Rgb> light;
  for (const auto& p : page_picture(lit, page).rgba) {
    const double factor = scale * (rgbm ? std::pow(p[3] / 255.0, 2.2) : 1);
    const auto value = [&](std::uint8_t code) {
      return float(factor * (rgbm ? code / 255.0 : linear_of(code)));
    };
    light.push_back({value(p[0]), value(p[1]), value(p[2])});
  }
  return light;
}

}  // namespace kiln::output
