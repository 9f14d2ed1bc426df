#include "baker/output/picture.h"

#include "baker/output/post.h"

namespace kiln::output {
namespace {

/// A map from a channel's values to 0..1: (v - zero) * scale.
struct Linear {
  math::Rgb zero, scale{1, 1, 1};
};

/// Returns 1 / extent, or 0 where a channel has only one value.
float inverse(float extent) {
  return extent > 0 && std::isfinite(extent) ? 1 / extent : 0;
}

Linear linear_map(Shown shown, const ValueRange& range) {
  if (shown == Shown::kSigned) return {{-1, -1, -1}, {0.5f, 0.5f, 0.5f}};
  if (shown == Shown::kOverMaximum) {
    const float scale = inverse(max_channel(range.max));
    return {{}, {scale, scale, scale}};
  }
  if (shown != Shown::kWithinBounds) return {};
  const math::Rgb extent = range.max - range.min;
  return {range.min, {inverse(extent.r), inverse(extent.g), inverse(extent.b)}};
}

}  // namespace

std::vector<std::array<std::uint8_t, 3>> show(const image::PageImage& image, Shown shown, Tone tone,
                                              const ValueRange& range) {
  if (is_light(shown)) return tone_map(image, tone);
  std::vector<std::array<std::uint8_t, 3>> out(image.rgb.size());
  const Linear map = linear_map(shown, range);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const math::Rgb v = (image.rgb[i] - map.zero) * map.scale;
    if (shown == Shown::kColor)
      out[i] = {encode_srgb(v.r), encode_srgb(v.g), encode_srgb(v.b)};
    else
      out[i] = {plain_code(v.r), plain_code(v.g), plain_code(v.b)};
  }
  return out;
}

}  // namespace kiln::output
