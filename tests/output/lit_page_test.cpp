#include "baker/output/lit_page.h"

#include <gtest/gtest.h>

#include "tests/output/lit_light.h"

namespace kiln::output {
namespace {

using proto::GlbLightmap;

image::PageImage page_of(std::uint32_t width, std::uint32_t height, math::Rgb value) {
  const std::size_t count = std::size_t(width) * height;
  return {width, height, std::vector<math::Rgb>(count, value), std::vector<float>(count, 1)};
}

TEST(LitPage, TheValuesOfCodesAreExact) {
  const auto e = [](std::uint8_t code) { return float(510 * linear_of(code)); };
  const image::PageImage page{2, 1, {{510, e(10), 0}, {e(1), 510, -1}}, {1, 1}};
  const auto lit = encode_lit_page(page, {}, GlbLightmap::kSrgb8);
  ASSERT_TRUE(lit);
  EXPECT_EQ(lit->scale, 510);
  EXPECT_EQ(lit->clipped, 0u);
  const std::vector<std::array<std::uint8_t, 3>> codes{{255, 10, 0}, {1, 255, 0}};
  EXPECT_EQ(lit->png, *image::encode_png(codes, 2, 1));
  const image::PageImage black{1, 1, {{}}, {1}};
  for (const GlbLightmap form : {GlbLightmap::kSrgb8, GlbLightmap::kRgbm})
    EXPECT_EQ(encode_lit_page(black, {}, form)->scale, 1);
}

TEST(LitPage, EveryCodeIsFoundAndBrightValuesAreRounded) {
  // Each code's own value, and a value of 0.4 and one of 0.6 steps beyond it.
  image::PageImage page = page_of(256, 3, {});
  for (std::uint32_t code = 0; code < 256; ++code)
    for (std::uint32_t row = 0; row < 3; ++row) {
      const double low = linear_of(std::uint8_t(code));
      const double step = code < 255 ? linear_of(std::uint8_t(code + 1)) - low : 0;
      const float v = float(low + std::array{0.0, 0.4, 0.6}[row] * step);
      page.rgb[row * 256 + code] = {v, v, v};
    }
  const Picture8 picture = decode_picture(encode_lit_page(page, {}, GlbLightmap::kSrgb8)->png);
  for (std::uint32_t code = 0; code < 256; ++code)
    for (std::size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(picture.rgba[code][c], code);
      if (code < 80 || code == 255) continue;
      EXPECT_EQ(picture.rgba[256 + code][c], code);
      EXPECT_EQ(picture.rgba[512 + code][c], code + 1);
    }
}

TEST(LitPage, BetweenDarkCodesTheMeanIsKept) {
  constexpr std::uint32_t kSide = 16;
  const std::array dark{0.0001f, 0.0007f, 0.01f};  // of codes 0.3, 2.3 and 25.4
  image::PageImage page = page_of(kSide, kSide, {dark[0], dark[1], dark[2]});
  page.rgb[0] = {1, 1, 1};
  const auto lit = encode_lit_page(page, {}, GlbLightmap::kSrgb8);
  ASSERT_TRUE(lit);
  const Picture8 picture = decode_picture(lit->png);
  for (std::size_t c = 0; c < 3; ++c) {
    double sum = 0;
    std::uint8_t least = 255, most = 0;
    for (std::size_t i = 1; i < picture.rgba.size(); ++i) {
      const std::uint8_t code = picture.rgba[i][c];
      sum += linear_of(code);
      least = std::min(least, code), most = std::max(most, code);
    }
    EXPECT_EQ(most, least + 1);
    // Even points in a 16 x 16 square miss a threshold by few: their discrepancy is log(n)/n.
    EXPECT_NEAR(sum / (kSide * kSide - 1), double(dark[c]),
                0.04 * (linear_of(most) - linear_of(least)));
  }
}

TEST(LitPage, LampsAreLeftOutOfTheScaleAndCounted) {
  image::PageImage page = page_of(20, 20, {1, 2, 3});
  std::vector<bool> lamps(400, false);
  for (const std::size_t lamp : {0, 1, 2}) {
    page.rgb[lamp] = {900, 1000, 1100};
    lamps[lamp] = true;
  }
  page.rgb[3] = {4, 4, 4};  // a lamp that is dark
  lamps[3] = true;
  const auto lit = encode_lit_page(page, lamps, GlbLightmap::kSrgb8);
  ASSERT_TRUE(lit);
  EXPECT_EQ(lit->scale, 3);
  EXPECT_EQ(lit->clipped, 4u);
  EXPECT_EQ(lit->clipped_lamps, 4u);
  // Where only lamps are lit, they make the scale.
  for (std::size_t i = 4; i < 400; ++i) page.rgb[i] = {};
  EXPECT_EQ(lit_scale(page, lamps), 1100);
  EXPECT_EQ(lit_scale(page, {}), 1100);
}

TEST(LitPage, AStrayTexelIsClippedAndAHighlightIsNot) {
  image::PageImage page = page_of(100, 100, {1, 1, 1});
  page.rgb[5000] = {1e6f, 1, 1};
  EXPECT_EQ(lit_scale(page, {}), 1);
  const auto lit = encode_lit_page(page, {}, GlbLightmap::kSrgb8);
  EXPECT_EQ(lit->clipped, 1u);
  EXPECT_EQ(lit->clipped_lamps, 0u);
  // Ten texels in ten thousand may be clipped. Eleven are too many, whatever they cost.
  for (std::size_t i = 0; i < 11; ++i) page.rgb[i] = {1e6f, 1, 1};
  EXPECT_EQ(lit_scale(page, {}), 1e6f);
  // Twice the mean costs the codes of the others less than clipping costs those ten.
  for (std::size_t i = 0; i < 10; ++i) page.rgb[i] = {2, 2, 2};
  page.rgb[10] = page.rgb[5000] = {1, 1, 1};
  EXPECT_EQ(lit_scale(page, {}), 2);
}

TEST(LitPage, PaddingDoesNotCount) {
  image::PageImage page = page_of(40, 40, {1, 1, 1});
  page.rgb[7] = {50, 50, 50};
  page.coverage[7] = 0;
  const auto lit = encode_lit_page(page, {}, GlbLightmap::kSrgb8);
  EXPECT_EQ(lit->scale, 1);
  EXPECT_EQ(lit->clipped, 0u);
}

/// The factor is the least that holds the brightest channel, and colors are rounded beneath it.
TEST(LitPage, RgbmHoldsFiveDecades) {
  image::PageImage page = page_of(64, 1, {});
  for (std::size_t i = 0; i < 64; ++i) {
    const float v = 3000 * std::pow(10.f, -5 * float(i) / 63);
    page.rgb[i] = {v, 0.5f * v, 0};
  }
  const auto lit = encode_lit_page(page, {}, GlbLightmap::kRgbm);
  ASSERT_TRUE(lit);
  EXPECT_EQ(lit->scale, 3000);
  EXPECT_EQ(lit->clipped, 0u);
  const Picture8 picture = decode_picture(lit->png);
  for (std::size_t i = 0; i < 64; ++i) {
    const auto& p = picture.rgba[i];
    const double factor = 3000 * std::pow(p[3] / 255.0, 2.2);
    const double v = double(page.rgb[i].r);
    EXPECT_NEAR(factor * p[0] / 255, v, factor / 255 * 0.51) << i;
    EXPECT_NEAR(factor * p[1] / 255, v / 2, factor / 255 * 0.51) << i;
    EXPECT_LE(factor * std::pow(1 - 1.0 / p[3], 2.2), v * 1.0001)
        << i << ": a smaller one holds it";
    EXPECT_EQ(p[2], 0);
  }
}

TEST(LitPage, NoPageIsMadeWhereNoneIsAskedFor) {
  const auto lit = encode_lit_page(page_of(4, 4, {1, 1, 1}), {}, GlbLightmap::kNone);
  ASSERT_TRUE(lit);
  EXPECT_EQ(lit->png, "");
}

TEST(UnlitPage, HasThePreviewsColorsAndAlpha) {
  const image::PageImage light = page_of(2, 1, {10, 20, 80});
  image::PageImage alpha = page_of(2, 1, {1, 0, 0});
  alpha.rgb[1].r = 0.2f;
  const auto opaque = encode_unlit_page(light, nullptr, 0.05f);
  ASSERT_TRUE(opaque);
  EXPECT_EQ(opaque->exposure, 0.05f);
  EXPECT_EQ(opaque->png, *image::encode_png(tone_map(light, {0.05f}), 2, 1));
  const Picture8 holes = decode_picture(encode_unlit_page(light, &alpha, 0.05f)->png);
  EXPECT_EQ(holes.rgba[0][3], 255);
  EXPECT_EQ(holes.rgba[1][3], 51);
  EXPECT_EQ(holes.rgba[1][2], 255);  // 4 is white
}

}  // namespace
}  // namespace kiln::output
