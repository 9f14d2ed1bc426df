#include "baker/output/layers.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kiln::output {
namespace {

using math::Rgb;

TexelValue irradiance(const OutputInput& in) {
  return [&shown = in.filtered](auto i) -> Rgb {
    return shown.direct[i] + shown.sky[i] + shown.indirect[i];
  };
}
TexelValue direct(const OutputInput& in) {
  return [&shown = in.filtered](auto i) -> Rgb { return shown.direct[i] + shown.sky[i]; };
}
TexelValue indirect(const OutputInput& in) {
  return [&shown = in.filtered](auto i) -> Rgb { return shown.indirect[i]; };
}
TexelValue raw(const OutputInput& in) {
  return [&light = in.light](auto i) -> Rgb { return light.irradiance(i); };
}
TexelValue standard_error(const OutputInput& in) {
  return [&shown = in.filtered](auto i) -> Rgb {
    const float d = shown.direct_variance[i], gathered = shown.gathered_variance[i];
    return {std::sqrt(d + gathered), std::sqrt(d), std::sqrt(gathered)};
  };
}
TexelValue samples(const OutputInput& in) {
  return [&light = in.light](auto i) -> Rgb {
    return {float(light.samples[i]), float(light.direct_samples[i]), 0};
  };
}

constexpr std::array kLayers{
    Layer{"irradiance", irradiance},
    Layer{"direct", direct},
    Layer{"indirect", indirect},
    Layer{"raw", raw},
    Layer{"standard_error", standard_error},
    Layer{"samples", samples},
};
static_assert(std::ranges::equal(
                  kLayers, proto::kLayerNames, {},
                  [](const Layer& l) { return std::string_view(l.name); },
                  [](const proto::Word& w) { return std::string_view(w.name); }),
              "each name of proto::kLayerNames needs a layer, in the same order");

}  // namespace

std::span<const Layer> layers() {
  return kLayers;
}

const Layer* find_layer(std::string_view name) {
  const auto found =
      std::ranges::find(kLayers, name, [](const Layer& l) { return std::string_view(l.name); });
  return found == kLayers.end() ? nullptr : &*found;
}

}  // namespace kiln::output
