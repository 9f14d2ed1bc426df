#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "baker/math/vec.h"

namespace kiln::test {

/// A picture of the sky to be written into a file. Row 0 = top.
struct SkyPicture {
  std::uint32_t width = 0, height = 0;
  std::vector<math::Rgb> pixels;

  /// From the radiance by direction, at the middles of the pixels. What a scene sees of it when it
  /// is not turned.
  SkyPicture(std::uint32_t rows, const std::function<math::Rgb(math::Vec3)>& radiance)
      : width(2 * rows), height(rows) {
    for (std::uint32_t y = 0; y < height; ++y)
      for (std::uint32_t x = 0; x < width; ++x) {
        const float theta = math::kPi * (float(y) + 0.5f) / float(height);
        const float phi = 2 * math::kPi * ((float(x) + 0.5f) / float(width) - 0.5f);
        pixels.push_back(radiance(
            {std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)}));
      }
  }
};

/// How a Radiance file stores its rows.
enum class HdrRows { kPacked, kPlain, kRepeated };
/// @param lines more of the header, each with its end
std::string hdr_file(const SkyPicture&, HdrRows = HdrRows::kPacked, const std::string& lines = "");
/// What is left of a value in such a file.
math::Rgb hdr_rounded(math::Rgb);

struct ExrStorage {
  bool half = false, tiled = false;
  int compression = 3;  ///< as the file has it: 3 is ZIP
  std::vector<std::string> channels{"R", "G", "B"};
  /// CIE xy of red, green, blue and white; empty: the file doesn't tell.
  std::vector<float> chromaticities{};
};
std::string exr_file(const SkyPicture&, const ExrStorage& = {});

}  // namespace kiln::test
