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
  /// Gives the layer's value of a texel. The value reads the input, which outlives it.
  TexelValue (*value)(const OutputInput&);
  Shown shown;  ///< the colors of its pictures
};

/// Returns all layers, in the order of proto::kLayerNames. The first is the irradiance.
std::span<const Layer> layers();
/// Returns the layer of that name, or null.
const Layer* find_layer(std::string_view name);

}  // namespace kiln::output
