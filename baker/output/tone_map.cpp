#include <cmath>
#include <limits>

#include "baker/output/post.h"

namespace kiln::output {
namespace {

constexpr double kPercentile = 0.95;
constexpr float kPercentileTarget = 0.8f;
constexpr float kWhite = 4;  // the exposed value that the curve maps to 1

/// Reinhard's curve with a white point: x (1 + x/w^2) / (1 + x), monotone, 1 from w on.
float curve(float x) {
  if (!(x > 0)) return 0;  // NaN too
  if (x >= kWhite) return 1;
  return x * (1 + x / (kWhite * kWhite)) / (1 + x);
}

/// The curve of Moreno-Fortuny 4.4.2.
float hyperbola(float x, float k) {
  if (!(x > 0)) return 0;  // NaN too
  return x < std::numeric_limits<float>::max() ? x / (k + x) : 1;
}

std::vector<float> lit_luminance(const image::PageImage& image) {
  std::vector<float> lit;
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    const float y = luminance(image.rgb[i]);
    if (image.coverage[i] > 0 && std::isfinite(y)) lit.push_back(std::max(y, 0.f));
  }
  return lit;
}

}  // namespace

std::uint8_t plain_code(float v) {
  if (!(v > 0)) return 0;  // NaN too
  return static_cast<std::uint8_t>(std::min(v, 1.f) * 255 + 0.5f);
}

std::uint8_t encode_srgb(float linear) {
  if (!(linear > 0)) return 0;  // NaN too
  const float c =
      linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::clamp(c * 255 + 0.5f, 0.f, 255.f));
}

float automatic_exposure(const image::PageImage& image) {
  return automatic_exposure(lit_luminance(image));
}

float automatic_exposure(std::vector<float> lit) {
  if (lit.empty()) return 1;
  const auto rank = std::size_t(std::ceil(kPercentile * double(lit.size()))) - 1;
  std::nth_element(lit.begin(), lit.begin() + std::ptrdiff_t(rank), lit.end());
  float level = lit[rank];
  // A small bright spot in the dark leaves the percentile black, so the maximum decides.
  if (level <= 0) level = *std::max_element(lit.begin(), lit.end());
  const float exposure = kPercentileTarget / level;
  return level > 0 && std::isfinite(exposure) ? exposure : 1;
}

Tone tone_of(const image::PageImage& image, std::optional<float> exposure, std::optional<float> k) {
  if (exposure) return {*exposure};
  if (!k) return {automatic_exposure(image)};
  float most = 0;
  for (std::size_t i = 0; i < image.rgb.size(); ++i)
    if (image.coverage[i] > 0 && std::isfinite(max_channel(image.rgb[i])))
      most = std::max(most, max_channel(image.rgb[i]));
  const float scale = 1 / most;
  return {most > 0 && std::isfinite(scale) ? scale : 1, k};
}

std::vector<std::array<std::uint8_t, 3>> tone_map(const image::PageImage& image, Tone tone) {
  const auto code = [k = tone.k](float x) {
    return k ? plain_code(hyperbola(x, *k)) : encode_srgb(curve(x));
  };
  std::vector<std::array<std::uint8_t, 3>> out(image.rgb.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const math::Rgb v = image.rgb[i] * tone.exposure;
    out[i] = {code(v.r), code(v.g), code(v.b)};
  }
  return out;
}

}  // namespace kiln::output
