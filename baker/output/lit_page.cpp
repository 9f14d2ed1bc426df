#include "baker/output/lit_page.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>

#include "baker/image/image.h"

namespace kiln::output {
namespace {

using Pixel = std::array<float, 3>;

Pixel channels(math::Rgb v) {
  return {v.r, v.g, v.b};
}

// Scale -------------------------------------------------------------------------------------------

/// One lit texel in so many may be clipped.
constexpr std::size_t kOneInMany = 1000;
/// An error that nobody minds, over the mean. Dithering adds up to a tenth to what is computed.
constexpr double kFineError = 0.009;

/// Sorts positive floats into classes, 16 to an octave.
constexpr std::uint32_t kClassBits = 19;
constexpr std::uint32_t kClasses = 1u << (31 - kClassBits);
std::uint32_t class_of(float v) {
  return std::bit_cast<std::uint32_t>(v) >> kClassBits;
}
float middle_of(std::uint32_t kind) {
  return std::bit_cast<float>((kind << kClassBits) + (1u << (kClassBits - 1)));
}

/// The light of a page that its scale depends on.
struct Range {
  std::vector<float> brightest;                  ///< of each texel its largest channel
  std::array<std::uint32_t, kClasses> counts{};  ///< of its channels
  double sum = 0;                                ///< of its channels

  void add(math::Rgb v) {
    brightest.push_back(max_channel(v));
    for (const float c : channels(v))
      if (c > 0) ++counts[class_of(c)], sum += double(c);
  }
  std::size_t most_clipped() const { return brightest.size() / kOneInMany; }
  /// Brings those that may be clipped to the front, and the next one, the brightest first.
  void sort_top() {
    const auto last = brightest.begin() + std::ptrdiff_t(most_clipped());
    std::nth_element(brightest.begin(), last, brightest.end(), std::greater<>());
    std::sort(brightest.begin(), last + 1, std::greater<>());
  }
  bool is_dark() const {
    return std::ranges::none_of(brightest, [](float v) { return v > 0; });
  }
};

Range range_of(const image::PageImage& image, const std::vector<bool>& lamps, bool with_lamps) {
  Range range;
  for (std::size_t i = 0; i < image.rgb.size(); ++i)
    if (image.coverage[i] > 0 && (with_lamps || lamps.empty() || !lamps[i]))
      range.add(image.rgb[i]);
  return range;
}

/// Returns the sum of the squares of what rounding to codes changes: a twelfth of a step's square.
double code_error(const Range& range, float scale) {
  double sum = 0;
  for (std::uint32_t kind = 0; kind < kClasses; ++kind) {
    if (range.counts[kind] == 0) continue;
    const double x = std::min(double(middle_of(kind)) / double(scale), 1.0);
    const double slope = x <= 0.0031308 ? 1 / 12.92 : 2.4 / 1.055 * std::pow(x, 1.4 / 2.4);
    const double step = slope * double(scale) / 255;
    sum += range.counts[kind] * step * step / 12;
  }
  return sum;
}

struct Choice {
  float scale = 1;
  double error = 0;  ///< sum of squares over all channels
};

/// Returns the scale with the least error.
Choice least_error(const Range& range) {
  const std::vector<float>& values = range.brightest;
  Choice best{values[0], code_error(range, values[0])};
  for (std::size_t clipped = 0; clipped < range.most_clipped();) {
    clipped = std::min(clipped + 1 + clipped / 8, range.most_clipped());
    const float scale = values[clipped];
    if (!(scale > 0)) break;
    double error = code_error(range, scale);
    for (std::size_t i = 0; i < clipped; ++i) {
      const double lost = double(values[i] - scale);
      error += 3 * lost * lost;
    }
    if (error < best.error) best = {scale, error};
  }
  return best;
}

// Codes -------------------------------------------------------------------------------------------

/// Returns a threshold in [0, 1) for a texel and channel. Thresholds fill the interval evenly over
/// any small neighborhood: they are the two-dimensional Kronecker sequence of the plastic number.
float threshold(std::uint32_t x, std::uint32_t y, std::uint32_t channel) {
  constexpr double kX = 0.7548776662466927, kY = 0.5698402909980532;
  const double t = kX * double(x) + kY * double(y) + double(channel) / 3;
  return float(t - double(std::int64_t(t)));  // t >= 0, so the cast is its floor
}

/// Finds the sRGB codes of values in 0..1.
class SrgbCodes {
 public:
  SrgbCodes() {
    for (std::uint32_t code = 0; code < 256; ++code)
      linear_[code] = scene::srgb_to_linear(std::uint8_t(code));
    std::uint32_t code = 0;
    for (std::uint32_t kind = 0; kind < kBelowOne; ++kind) {
      const float least = std::bit_cast<float>(kind << kClassBits);
      while (code < 254 && linear_[code + 1] <= least) ++code;
      first_[kind] = std::uint8_t(code);
    }
  }

  std::uint8_t code(float v, float threshold) const {
    if (!(v > 0)) return 0;
    if (v >= 1) return 255;
    std::uint32_t code = first_[class_of(v)];
    while (code < 254 && linear_[code + 1] <= v) ++code;
    const float share = (v - linear_[code]) / (linear_[code + 1] - linear_[code]);
    // The pattern is 0.996 wide, so that a value that is a code's own stays so through rounding.
    const float width = 0.996f * std::clamp((kFine - float(code)) / (kFine - kCoarse), 0.f, 1.f);
    return std::uint8_t(code + (share > 0.5f + width * (threshold - 0.5f)));
  }

 private:
  /// Below kCoarse a step is more than 4 % of the value, and all of it is dithered; from kFine on
  /// it is less than 3 %, and nothing is, since the pattern has twice the variance of rounding.
  static constexpr float kCoarse = 40, kFine = 80;
  static constexpr std::uint32_t kBelowOne = 0x3F800000u >> kClassBits;

  std::array<float, 256> linear_{};
  std::array<std::uint8_t, kBelowOne> first_{};  ///< by class: the code of its least value
};

std::vector<std::uint8_t> srgb_samples(const image::PageImage& image, float scale) {
  const SrgbCodes codes;
  std::vector<std::uint8_t> samples(image.rgb.size() * 3);
  std::size_t i = 0;
  for (std::uint32_t y = 0; y < image.height; ++y)
    for (std::uint32_t x = 0; x < image.width; ++x, ++i) {
      const Pixel e = channels(image.rgb[i]);
      for (std::uint32_t c = 0; c < 3; ++c)
        samples[3 * i + c] = codes.code(e[c] / scale, threshold(x, y, c));
    }
  return samples;
}

std::vector<std::uint8_t> rgbm_samples(const image::PageImage& image, float scale) {
  std::array<float, 256> factor{};
  for (std::uint32_t a = 0; a < 256; ++a) factor[a] = std::pow(float(a) / 255, kRgbmPower);
  std::vector<std::uint8_t> samples(image.rgb.size() * 4);
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    const float most = std::min(max_channel(image.rgb[i]) / scale, 1.f);
    std::uint32_t alpha = 1;  // of black: an image without alpha may lose its color
    if (most > 0) {
      alpha = std::uint32_t(std::ceil(255 * std::pow(most, 1 / kRgbmPower)));
      alpha = std::clamp(alpha, 1u, 255u);
      if (alpha < 255 && factor[alpha] < most) ++alpha;
    }
    const Pixel e = channels(image.rgb[i]);
    for (std::size_t c = 0; c < 3; ++c)
      samples[4 * i + c] = plain_code(e[c] / scale / factor[alpha]);
    samples[4 * i + 3] = std::uint8_t(alpha);
  }
  return samples;
}

proto::Expected<void> set_png(LitPage& page, const image::PageImage& size,
                              const std::vector<std::uint8_t>& samples, int channel_count) {
  auto png = image::encode_png(samples, size.width, size.height, channel_count);
  if (!png) return proto::Unexpected(png.error());
  page.png = std::move(*png);
  return {};
}

}  // namespace

float lit_scale(const image::PageImage& image, const std::vector<bool>& lamps) {
  Range range = range_of(image, lamps, false);
  if (range.is_dark()) range = range_of(image, lamps, true);
  if (range.is_dark()) return 1;
  range.sort_top();
  const Choice best = least_error(range);
  const double values = 3 * double(range.brightest.size());
  const double allowed = kFineError * range.sum / values;
  const float percentile = range.brightest[range.most_clipped()];
  return best.error <= values * allowed * allowed || !(percentile > 0) ? best.scale : percentile;
}

proto::Expected<LitPage> encode_lit_page(const image::PageImage& image,
                                         const std::vector<bool>& lamps,
                                         proto::GlbLightmap lightmap) {
  LitPage page;
  if (lightmap == proto::GlbLightmap::kNone) return page;
  if (lightmap == proto::GlbLightmap::kRgbm) {
    float most = 0;
    for (const math::Rgb v : image.rgb) most = std::max(most, max_channel(v));
    if (most > 0) page.scale = most;
    if (auto ok = set_png(page, image, rgbm_samples(image, page.scale), 4); !ok)
      return proto::Unexpected(ok.error());
    return page;
  }
  page.scale = lit_scale(image, lamps);
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    if (!(image.coverage[i] > 0) || max_channel(image.rgb[i]) <= page.scale) continue;
    ++page.clipped;
    page.clipped_lamps += !lamps.empty() && lamps[i];
  }
  if (auto ok = set_png(page, image, srgb_samples(image, page.scale), 3); !ok)
    return proto::Unexpected(ok.error());
  return page;
}

proto::Expected<LitPage> encode_unlit_page(const image::PageImage& light,
                                           const image::PageImage* alpha, float exposure) {
  LitPage page;
  page.exposure = exposure;
  const auto colors = tone_map(light, {exposure});
  const std::size_t channel_count = alpha ? 4 : 3;
  std::vector<std::uint8_t> samples(colors.size() * channel_count);
  for (std::size_t i = 0; i < colors.size(); ++i) {
    std::copy(colors[i].begin(), colors[i].end(), &samples[channel_count * i]);
    if (alpha) samples[4 * i + 3] = plain_code(alpha->rgb[i].r);
  }
  if (auto ok = set_png(page, light, samples, int(channel_count)); !ok)
    return proto::Unexpected(ok.error());
  return page;
}

}  // namespace kiln::output
