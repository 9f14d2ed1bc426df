#include "baker/output/lit_page.h"

#include "baker/output/png.h"

namespace kiln::baker {

proto::Expected<LitPage> encode_lit_page(const PageImage& image) {
  LitPage page;
  float max = 0;
  for (const Rgb v : image.rgb) max = std::max(max, max_channel(v));
  if (max > 0) page.scale = max;

  std::vector<std::uint8_t> samples;
  samples.reserve(image.rgb.size() * 3);
  const float to_code = 255 / page.scale;
  for (const Rgb v : image.rgb)
    for (const float e : {v.r, v.g, v.b})
      samples.push_back(static_cast<std::uint8_t>(std::clamp(e * to_code + 0.5f, 0.f, 255.f)));
  auto png = encode_png_bytes(samples, image.width, image.height, 3);
  if (!png) return proto::Unexpected(png.error());
  page.png = std::move(*png);
  return page;
}

}  // namespace kiln::baker
