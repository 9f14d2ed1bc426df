#include "baker/output/lit_page.h"

#include "baker/image/image.h"

namespace kiln::output {
namespace {

/// Returns a threshold in [0, 1) for a texel and channel. Thresholds fill the interval evenly over
/// any small neighborhood: they are the two-dimensional Kronecker sequence of the plastic number.
float threshold(std::uint32_t x, std::uint32_t y, std::uint32_t channel) {
  constexpr double kX = 0.7548776662466927, kY = 0.5698402909980532;
  const double t = kX * double(x) + kY * double(y) + double(channel) / 3;
  return float(t - double(std::int64_t(t)));  // t >= 0, so the cast is its floor
}

}  // namespace

proto::Expected<LitPage> encode_lit_page(const image::PageImage& image) {
  LitPage page;
  float max = 0;
  for (const math::Rgb v : image.rgb) max = std::max(max, max_channel(v));
  if (max > 0) page.scale = max;

  std::vector<std::uint8_t> samples(image.rgb.size() * 3);
  const float to_code = 255 / page.scale;
  std::size_t i = 0;
  for (std::uint32_t y = 0; y < image.height; ++y) {
    for (std::uint32_t x = 0; x < image.width; ++x, ++i) {
      const std::array<float, 3> e{image.rgb[i].r, image.rgb[i].g, image.rgb[i].b};
      for (std::uint32_t c = 0; c < 3; ++c) {
        // Two thousandths at both ends keep whole codes whole through the rounding of e * to_code.
        const float code = e[c] * to_code + 0.002f + 0.996f * threshold(x, y, c);
        samples[3 * i + c] = static_cast<std::uint8_t>(std::clamp(code, 0.f, 255.f));
      }
    }
  }
  auto png = image::encode_png(samples, image.width, image.height, 3);
  if (!png) return proto::Unexpected(png.error());
  page.png = std::move(*png);
  return page;
}

}  // namespace kiln::output
