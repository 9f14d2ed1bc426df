#include <cmath>

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

std::vector<float> lit_luminance(const image::PageImage& image) {
  std::vector<float> lit;
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    const float y = luminance(image.rgb[i]);
    if (image.coverage[i] > 0 && std::isfinite(y)) lit.push_back(std::max(y, 0.f));
  }
  return lit;
}

}  // namespace

std::uint8_t encode_srgb(float linear) {
  if (!(linear > 0)) return 0;  // NaN too
  const float c =
      linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
  return static_cast<std::uint8_t>(std::clamp(c * 255 + 0.5f, 0.f, 255.f));
}

float automatic_exposure(const image::PageImage& image) {
  std::vector<float> lit = lit_luminance(image);
  if (lit.empty()) return 1;
  const auto rank = std::size_t(std::ceil(kPercentile * double(lit.size()))) - 1;
  std::nth_element(lit.begin(), lit.begin() + std::ptrdiff_t(rank), lit.end());
  float level = lit[rank];
  // A small bright spot in the dark leaves the percentile black, so the maximum decides.
  if (level <= 0) level = *std::max_element(lit.begin(), lit.end());
  const float exposure = kPercentileTarget / level;
  return level > 0 && std::isfinite(exposure) ? exposure : 1;
}

std::vector<std::array<std::uint8_t, 3>> tone_map(const image::PageImage& image, float exposure) {
  std::vector<std::array<std::uint8_t, 3>> out(image.rgb.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const math::Rgb v = image.rgb[i] * exposure;
    out[i] = {encode_srgb(curve(v.r)), encode_srgb(curve(v.g)), encode_srgb(curve(v.b))};
  }
  return out;
}

}  // namespace kiln::output
