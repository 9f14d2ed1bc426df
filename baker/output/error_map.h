#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "baker/output/compare.h"

namespace kiln::output {

using Color = std::array<std::uint8_t, 3>;

/// An 8-bit RGB picture, row 0 = top.
struct Picture {
  std::uint32_t width = 0, height = 0;
  std::vector<Color> pixels;
};

/// Returns the color of a share, 0 to 1, on the ramp "ember": black, violet, red, orange, yellow,
/// white. It grows lighter all the way. A NaN is white.
Color ember(double share);
/// The color of texels that an error map says nothing about: those not lit in both images.
inline constexpr Color kNothing{48, 56, 64};

/// Shows the luminance_difference() of each texel on the ramp; `full` and more is white.
Picture error_map(const PagePair&, double full);

/// The luminances that contours() draws, of 255 [Moreno-Fortuny fig. 5.2].
inline constexpr std::array<int, 5> kContourLevels{40, 70, 90, 120, 140};
/// The colors of contours(): of the reference, of the candidate, and where both go.
inline constexpr Color kReferenceLine{255, 144, 0}, kCandidateLine{0, 144, 255},
    kCommonLine{255, 255, 255};

/// Draws the lines along which the luminance of the two images, 255 v / scale, goes through
/// kContourLevels, over a dark picture of the reference. Texels are interpolated within what is
/// lit; small images are drawn larger, by a whole factor.
Picture contours(const PagePair&, double scale);

}  // namespace kiln::output
