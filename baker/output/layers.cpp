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

// Surface -----------------------------------------------------------------------------------------

Rgb rgb(math::Vec3 v) {
  return {v.x, v.y, v.z};
}
Rgb gray(float v) {
  return {v, v, v};
}

TexelValue position(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb { return rgb(texels.position[i]); };
}
TexelValue normal(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb { return rgb(texels.shading_normal[i]); };
}
TexelValue albedo(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb { return texels.albedo[i]; };
}
TexelValue area(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb { return gray(texels.area_m2[i]); };
}
/// Returns the mean over the texel's points.
TexelValue emission(const OutputInput& in) {
  return [&scene = in.scene, &texels = in.texels](auto i) -> Rgb {
    Rgb sum;
    for (const atlas::SamplePoint& p : texels.points_of(i))
      if (is_emissive(scene, p.triangle)) sum += emission_at(scene, p.triangle, p.bary());
    return sum * (1.f / atlas::TextureGroup::kPointsPerTexel);
  };
}
TexelValue coverage(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb { return gray(texels.coverage[i]); };
}
TexelValue validity(const OutputInput& in) {
  return [&light = in.light](auto i) -> Rgb { return gray(light.validity[i]); };
}

TexelValue chart(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb { return color_of(texels.chart[i]); };
}

/// Dark and light squares are texels. Squares of sixteen texels differ in color, so that texels
/// can be counted where they are too small to be seen [RTRad fig. 4.15].
TexelValue texel_checker(const OutputInput& in) {
  return [&texels = in.texels](auto i) -> Rgb {
    constexpr Rgb kColors[2][2] = {{{0.08f, 0.08f, 0.1f}, {0.65f, 0.65f, 0.7f}},
                                   {{0.16f, 0.06f, 0.01f}, {0.85f, 0.5f, 0.15f}}};
    const unsigned x = texels.x[i], y = texels.y[i];
    return kColors[(x / 16 + y / 16) % 2][(x + y) % 2];
  };
}

constexpr TexelValue (*kMade)(const OutputInput&) = nullptr;

constexpr std::array kLayers{
    Layer{"irradiance", irradiance, Shown::kPageLight},
    Layer{"direct", direct, Shown::kPageLight},
    Layer{"indirect", indirect, Shown::kPageLight},
    Layer{"raw", raw, Shown::kPageLight},
    Layer{"standard_error", standard_error, Shown::kOwnLight},
    Layer{"samples", samples, Shown::kOverMaximum},
    Layer{"position", position, Shown::kWithinBounds},
    Layer{"normal", normal, Shown::kSigned},
    Layer{"albedo", albedo, Shown::kColor},
    Layer{"area", area, Shown::kOverMaximum},
    Layer{"emission", emission, Shown::kOwnLight},
    Layer{"coverage", coverage, Shown::kShare},
    Layer{"validity", validity, Shown::kShare},
    Layer{"chart", chart, Shown::kColor},
    Layer{"texel_checker", texel_checker, Shown::kColor},
    Layer{"mip", kMade, Shown::kOwnLight},
    Layer{"tree", kMade, Shown::kOverMaximum},
    Layer{"senders", kMade, Shown::kOverMaximum},
    Layer{"voxels", kMade, Shown::kColor},
    Layer{"error", kMade, Shown::kOwnLight},
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

proto::Expected<TexelValue> values_of(const Layer& layer, const OutputInput& in) {
  if (layer.value) return layer.value(in);
  const auto made = in.made.find(layer.name);
  if (made != in.made.end()) return made->second;
  return proto::fail("internal", std::string("The layer '") + layer.name + "' was not made.");
}

Rgb color_of(std::uint32_t number) {
  constexpr double kGolden = 0.6180339887498949;
  constexpr float kPale = 0.15f, kBright = 0.85f;
  const double turns = double(number) * kGolden;
  const float hue = 6 * float(turns - std::floor(turns));
  const auto channel = [&](float peak) {
    const float away = std::abs(hue - peak);  // sixths of the circle
    return std::clamp(2 - std::min(away, 6 - away), 0.f, 1.f) * (kBright - kPale) + kPale;
  };
  return {channel(0), channel(2), channel(4)};
}

}  // namespace kiln::output
