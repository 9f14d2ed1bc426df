#pragma once

#include <span>
#include <string_view>

#include "baker/output/output.h"
#include "baker/output/picture.h"
#include "baker/output/post.h"

namespace kiln::output {

/// A layer of the pages. A new one is a row of layers(), and a row of proto::kLayerNames.
struct Layer {
  const char* name;
  /// Gives the layer's value of a texel. The value reads the input, which outlives it. Null:
  /// whoever bakes makes the values, see OutputInput::made.
  TexelValue (*value)(const OutputInput&);
  Shown shown;  ///< the colors of its pictures
};

/// Returns all layers, in the order of proto::kLayerNames. The first is the irradiance.
std::span<const Layer> layers();
/// Returns the layer of that name, or null.
const Layer* find_layer(std::string_view name);
/// Returns the layer's values. Errors: `internal` where they had to be made, and are not.
proto::Expected<TexelValue> values_of(const Layer&, const OutputInput&);

/// Returns a color for a number. Hues of numbers that follow each other lie far apart, since they
/// advance by the golden section of the circle.
math::Rgb color_of(std::uint32_t number);

}  // namespace kiln::output
