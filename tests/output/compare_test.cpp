#include "baker/output/compare.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>

#include "baker/output/error_map.h"

namespace kiln::output {
namespace {

using image::PageImage;

PageImage row_of(const std::vector<float>& gray, float coverage = 1) {
  PageImage image{std::uint32_t(gray.size()), 1, {}, {}};
  for (const float g : gray) image.rgb.push_back({g, g, g});
  image.coverage.assign(gray.size(), coverage);
  return image;
}

TEST(Compare, KnownFigures) {
  PageImage reference{2, 1, {{1, 2, 3}, {2, 2, 2}}, {1, 1}};
  PageImage candidate{2, 1, {{2, 2, 3}, {2, 0, 2}}, {1, 1}};
  const CompareResult r = compare(reference, candidate);
  EXPECT_EQ(r.texels, 2u);
  EXPECT_DOUBLE_EQ(r.mean_reference, 2);
  EXPECT_DOUBLE_EQ(r.rmse, std::sqrt(5.0 / 6));
  EXPECT_DOUBLE_EQ(r.nrmse, std::sqrt(5.0 / 6) / 2);
  EXPECT_DOUBLE_EQ(r.bias, -1.0 / 6 / 2);
  EXPECT_DOUBLE_EQ(r.max_abs, 2);
  EXPECT_DOUBLE_EQ(r.dfpr, (1 + 2) / 2.0);
  const double a = 1 / 1.04, b = 2 / 2.04;
  EXPECT_DOUBLE_EQ(r.rel_rmse, std::sqrt((a * a + b * b) / 6));
}

TEST(Compare, OnlyTexelsLitInBoth) {
  PageImage reference{3, 1, {{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}, {1, 1, 0}};
  PageImage candidate{3, 1, {{1, 1, 1}, {9, 9, 9}, {9, 9, 9}}, {1, 0, 1}};
  const CompareResult r = compare(reference, candidate);
  EXPECT_EQ(r.texels, 1u);
  EXPECT_EQ(r.uncovered, 1u);
  EXPECT_EQ(r.rmse, 0);
}

TEST(Compare, CountsWhatIsNotFinite) {
  PageImage reference = row_of({1, 1});
  PageImage candidate = row_of({1, std::nanf("")});
  const CompareResult r = compare(reference, candidate);
  EXPECT_EQ(r.nonfinite, 1u);
  EXPECT_DOUBLE_EQ(r.rmse, std::sqrt(0.5));
  EXPECT_EQ(compare(row_of({0}, 0), row_of({0}, 0)).texels, 0u);
}

TEST(Compare, DfprOfPixelsCountsPaddingAndClampsToTheScale) {
  // One lit texel and one in the padding. The reference's largest lit channel, 4, counts as 1.
  const PageImage reference{2, 1, {{4, 2, 0}, {8, 0, 0}}, {1, 0}};
  const PageImage candidate{2, 1, {{6, 0, 3}, {2, 0, 4}}, {1, 0}};
  const CompareResult r = compare(reference, candidate);
  EXPECT_EQ(r.pixels, 2u);
  EXPECT_DOUBLE_EQ(r.scale, 4);
  // (1, .5, 0) to (1, 0, .75), and in the padding (1, 0, 0) to (.5, 0, 1).
  const double lit = std::sqrt(0.25 + 0.5625), padding = std::sqrt(0.25 + 1);
  EXPECT_DOUBLE_EQ(r.dfpr_lit, lit);
  EXPECT_DOUBLE_EQ(r.dfpr_all, (lit + padding) / 2);
  EXPECT_DOUBLE_EQ(r.dfpr, std::sqrt(4.0 + 4 + 9));
  // Black against white is the largest there is.
  EXPECT_DOUBLE_EQ(compare(row_of({7, 7}), row_of({0, 0})).dfpr_all, std::sqrt(3.0));
  EXPECT_DOUBLE_EQ(compare(row_of({4}), row_of({3}), 8).dfpr_all, std::sqrt(3.0) / 8);
}

TEST(Compare, SharesBeyondLevels) {
  // Differences of 9, 11, 26 and 41 of 255, up or down.
  const PageImage reference = row_of({255, 100, 100, 100}), candidate = row_of({246, 111, 74, 141});
  const CompareResult r = compare(reference, candidate);
  EXPECT_DOUBLE_EQ(r.scale, 255);
  EXPECT_EQ(r.beyond, (std::array{0.75, 0.5, 0.25}));
  // One channel counts by its part of the luminance: 20 of 255 in green is 14.3, in red 4.3.
  const PageImage dark{2, 1, {{0, 0, 0}, {0, 0, 0}}, {1, 1}};
  const PageImage tinted{2, 1, {{0, 20, 0}, {20, 0, 0}}, {1, 1}};
  EXPECT_EQ(compare(dark, tinted, 255).beyond, (std::array{0.5, 0.0, 0.0}));
}

TEST(Compare, HistogramsOfLuminance) {
  const CompareResult r = compare(row_of({0, 100, 400, 399}), row_of({-5, 200, 800, 3}));
  Histogram reference{}, candidate{};
  ++reference[0], ++reference[16];  // 100 of 400: 63.75 of 255
  reference[63] += 2;               // 399 of 400 is 254.4
  candidate[0] += 2;
  ++candidate[32], ++candidate[63];
  EXPECT_EQ(r.reference_histogram, reference);
  EXPECT_EQ(r.candidate_histogram, candidate);
  const std::string csv = histogram_csv(r);
  EXPECT_EQ(csv.substr(0, csv.find('\n', 30)), "from,to,reference,candidate\n0,3.98438,1,2");
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 65);
  EXPECT_NE(csv.find("\n63.75,67.7344,1,0\n"), std::string::npos) << csv;
  EXPECT_NE(csv.find("\n251.016,255,2,1\n"), std::string::npos) << csv;
}

TEST(Compare, ASecondReferenceTakesTheNoiseOut) {
  // The truth is 10. The references are off by 1 and -1 in turns that are not alike, x by 2.
  const PageImage a = row_of({11, 9, 11, 9}), c = row_of({11, 9, 9, 11}),
                  x = row_of({12, 12, 12, 12});
  const CompareResult r = compare(a, x, {}, &c);
  ASSERT_TRUE(r.unbiased);
  EXPECT_DOUBLE_EQ(r.rmse * r.rmse, 5);  // 4 of x, and 1 that is the reference's
  EXPECT_DOUBLE_EQ(r.unbiased->mse, (1.0 * 1 + 3 * 3 + 1 * 3 + 3 * 1) / 4);
  EXPECT_DOUBLE_EQ(r.unbiased->mse, 4);
  EXPECT_DOUBLE_EQ(r.unbiased->nrmse, 0.2);
  EXPECT_DOUBLE_EQ(r.unbiased->noise, std::sqrt((0 + 0 + 4 + 4) / 2.0 / 4) / 10);
  EXPECT_FALSE(compare(a, x).unbiased);
  // An error below the noise has no root.
  const PageImage other = row_of({3, 1});
  const CompareResult none = compare(row_of({1, 3}), row_of({2, 2}), {}, &other);
  EXPECT_DOUBLE_EQ(none.unbiased->mse, -1);
  EXPECT_EQ(none.unbiased->nrmse, 0);
}

TEST(Compare, PagesAreOneSetOfTexels) {
  const std::vector<float> a{1, 5, 2, 8}, b{2, 5, 0, 9};
  const CompareResult whole = compare(row_of(a), row_of(b));
  Comparison halves;
  const PageImage pages[]{row_of({a[0]}), row_of({b[0]}), row_of({a[1], a[2], a[3]}),
                          row_of({b[1], b[2], b[3]})};
  for (const int p : {0, 2}) halves.look_at({pages[p], pages[p + 1]});
  for (const int p : {0, 2}) halves.add({pages[p], pages[p + 1]});
  EXPECT_EQ(to_json(halves.result()), to_json(whole));
  EXPECT_DOUBLE_EQ(whole.scale, 8);
}

TEST(Compare, ABlackReferenceHasFiguresToo) {
  const CompareResult r = compare(row_of({0, 0}), row_of({0.5f, 0}));
  EXPECT_EQ(r.scale, 1);
  EXPECT_DOUBLE_EQ(r.dfpr_all, std::sqrt(0.75) / 2);
  EXPECT_EQ(r.nrmse, 0);
}

double luminance_of(Color c) {
  return double(math::luminance(math::Rgb{float(c[0]), float(c[1]), float(c[2])}));
}

TEST(ErrorMap, TheRampGrowsLighterFromBlackToWhite) {
  EXPECT_EQ(ember(0), (Color{0, 0, 0}));
  EXPECT_EQ(ember(-1), (Color{0, 0, 0}));
  for (const double full : {1.0, 2.0, std::numeric_limits<double>::infinity(), std::nan("")})
    EXPECT_EQ(ember(full), (Color{255, 255, 255})) << full;
  for (int i = 1; i <= 100; ++i)
    EXPECT_GT(luminance_of(ember(i / 100.0)), luminance_of(ember((i - 1) / 100.0))) << i;
}

TEST(ErrorMap, ShowsTheLuminanceOfTheDifferences) {
  const PageImage a{4, 1, {{1, 1, 1}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0}}, {1, 1, 1, 0}};
  const PageImage b{4, 1, {{1, 1, 1}, {0, 0, 0}, {0, 0, 1}, {9, 9, 9}}, {1, 1, 1, 1}};
  EXPECT_DOUBLE_EQ(luminance_difference(a.rgb[2], b.rgb[2]), 0.7152 + 0.0722);
  const Picture map = error_map({a, b}, 2);
  EXPECT_EQ(map.pixels,
            (std::vector<Color>{ember(0), ember(0.2126 / 2), ember(0.7874 / 2), kNothing}));
}

/// A page whose luminance grows from left to right, from 0 to 255 and a bit.
PageImage ramp(std::uint32_t width, float shift) {
  PageImage image{width, 8, {}, {}};
  for (std::uint32_t i = 0; i < width * 8; ++i) {
    const float v = float(i % width) + shift;
    image.rgb.push_back({v, v, v});
    image.coverage.push_back(1);
  }
  return image;
}

TEST(Contours, LiesWhereTheLuminancePassesALevel) {
  const PageImage a = ramp(1024, 0.5f), b = ramp(1024, -9.5f);
  const Picture picture = contours({a, b}, 255);
  ASSERT_EQ(picture.width, 1024u);  // large enough as it is
  ASSERT_EQ(picture.height, 8u);
  std::vector<int> orange, blue;
  for (int x = 0; x < 1024; ++x) {
    const Color c = picture.pixels[std::size_t(x)];
    if (c == kReferenceLine) orange.push_back(x);
    if (c == kCandidateLine) blue.push_back(x);
    EXPECT_EQ(c, picture.pixels[std::size_t(7 * 1024 + x)]);
  }
  EXPECT_EQ(orange, (std::vector{39, 69, 89, 119, 139}));
  EXPECT_EQ(blue, (std::vector{49, 79, 99, 129, 149}));
  const Picture same = contours({a, a}, 255);
  EXPECT_EQ(std::count(same.pixels.begin(), same.pixels.end(), kCommonLine), 5 * 8);
}

TEST(Contours, SmallImagesAreInterpolatedAndChartsKeptApart) {
  // Two charts, each of one luminance, and an empty column: no line but none across it.
  PageImage a = row_of({10, 10, 0, 200, 200});
  a.coverage[2] = 0;
  const Picture apart = contours({a, a}, 255);
  EXPECT_EQ(apart.width, 5u * 204);
  EXPECT_EQ(std::count(apart.pixels.begin(), apart.pixels.end(), kCommonLine), 0);
  EXPECT_EQ(std::count(apart.pixels.begin(), apart.pixels.end(), kNothing), 204 * 204);
  // Between 30 and 50 the level 40 lies in the middle of the texels' centers.
  const PageImage step = row_of({30, 50});
  const Picture line = contours({step, step}, 255);
  EXPECT_EQ(line.width, 1024u);
  std::vector<std::uint32_t> columns;
  for (std::uint32_t x = 0; x < line.width; ++x)
    if (line.pixels[x] == kCommonLine) columns.push_back(x);
  EXPECT_EQ(columns, (std::vector<std::uint32_t>{511}));
}

}  // namespace
}  // namespace kiln::output
