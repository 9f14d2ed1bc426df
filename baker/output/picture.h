#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "baker/image/page_image.h"
#include "baker/math/vec.h"
#include "baker/output/post.h"

namespace kiln::output {

/// The way in which the values of a layer become the colors of a picture. The first three make sRGB
/// codes (but see Tone::k), the others make codes in proportion to the values: they are figures,
/// not colors.
enum class Shown {
  kPageLight,     ///< a tone curve, at the exposure of the page's irradiance
  kOwnLight,      ///< a tone curve, at the exposure of the layer itself
  kColor,         ///< as it is, 0..1
  kShare,         ///< 0 is black, 1 is white
  kSigned,        ///< 0.5 + 0.5 v
  kOverMaximum,   ///< v / the largest channel of all pages
  kWithinBounds,  ///< 0 at the least value of a channel over all pages, 1 at its largest
};

/// Returns whether the values are light, which an exposure scales.
constexpr bool is_light(Shown shown) {
  return shown == Shown::kPageLight || shown == Shown::kOwnLight;
}

/// The least and the largest value of each channel.
struct ValueRange {
  math::Rgb min{kFar, kFar, kFar}, max{-kFar, -kFar, -kFar};

  void add(math::Rgb v) {
    min = {std::min(min.r, v.r), std::min(min.g, v.g), std::min(min.b, v.b)};
    max = {std::max(max.r, v.r), std::max(max.g, v.g), std::max(max.b, v.b)};
  }

 private:
  static constexpr float kFar = std::numeric_limits<float>::infinity();
};

/// Returns the 8-bit colors of an image's values. `tone` is for light, `range` for kOverMaximum and
/// kWithinBounds. A value that is no number becomes black.
std::vector<std::array<std::uint8_t, 3>> show(const image::PageImage&, Shown, Tone tone,
                                              const ValueRange& range);

}  // namespace kiln::output
