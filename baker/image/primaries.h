#pragma once

#include <array>
#include <optional>

#include "baker/math/vec.h"

namespace kiln::image {

/// CIE xy of red, green, blue and white, which say what colors the numbers of a picture mean. The
/// default is Rec. 709.
struct Primaries {
  using Point = std::array<float, 2>;
  Point red{0.64f, 0.33f}, green{0.3f, 0.6f}, blue{0.15f, 0.06f}, white{0.3127f, 0.329f};

  /// Ignores the last digits that files give.
  bool is_rec709() const;
};

/// Converts linear numbers by such primaries to linear Rec. 709. White stays white, of the same
/// luminance: colors are adapted from one white point to the other [Lam, "Metamerism and Colour
/// Constancy", 1985: the Bradford transform, in its linear form]. Colors that Rec. 709 can't show
/// get negative values.
class ColorConversion {
 public:
  /// Returns nothing when no mixture of the primaries is white, or as good as none.
  static std::optional<ColorConversion> from(const Primaries&);

  math::Rgb operator()(math::Rgb c) const {
    return {rows_[0][0] * c.r + rows_[0][1] * c.g + rows_[0][2] * c.b,
            rows_[1][0] * c.r + rows_[1][1] * c.g + rows_[1][2] * c.b,
            rows_[2][0] * c.r + rows_[2][1] * c.g + rows_[2][2] * c.b};
  }

 private:
  std::array<std::array<float, 3>, 3> rows_{};
};

}  // namespace kiln::image
