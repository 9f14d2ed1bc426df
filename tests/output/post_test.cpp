#include "baker/output/post.h"

#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace kiln::output {
namespace {

/// A group whose only page is drawn with characters: '.' is empty, a letter is a texel of that
/// chart.
atlas::TextureGroup draw(const std::vector<std::string>& rows) {
  atlas::TextureGroup group;
  atlas::TextureGroup::Page page;
  page.width = std::uint32_t(rows[0].size());
  page.height = std::uint32_t(rows.size());
  for (std::uint32_t y = 0; y < page.height; ++y)
    for (std::uint32_t x = 0; x < page.width; ++x) {
      if (rows[y][x] == '.') {
        page.texel_at.push_back(-1);
        continue;
      }
      page.texel_at.push_back(std::int32_t(group.coverage.size()));
      group.coverage.push_back(0.5f);
      group.chart.push_back(std::uint32_t(rows[y][x] - 'a'));
    }
  group.pages.push_back(page);
  group.front_count = std::uint32_t(group.coverage.size());
  return group;
}

/// One value per texel.
TexelValue at(std::vector<math::Rgb> values) {
  return [values = std::move(values)](std::uint32_t t) { return values[t]; };
}

/// The page after dilation as characters, each chart lit with its own value.
std::vector<std::string> dilated(const atlas::TextureGroup& group, std::uint32_t rings) {
  std::vector<math::Rgb> values;
  for (const std::uint32_t chart : group.chart) values.push_back({float(chart + 1), 0, 0});
  const image::PageImage image = compose_page(group, 0, at(values), rings);
  std::vector<std::string> rows(image.height);
  for (std::size_t i = 0; i < image.rgb.size(); ++i)
    rows[i / image.width] += image.rgb[i].r == 0 ? '.' : char('a' - 1 + int(image.rgb[i].r));
  return rows;
}

TEST(ComposePage, GutterOfFourIsSharedInTheMiddle) {
  const atlas::TextureGroup group = draw({"..aa....bb..", "..aa....bb.."});
  EXPECT_EQ(dilated(group, 1), (std::vector<std::string>{".aaaa..bbbb.", ".aaaa..bbbb."}));
  EXPECT_EQ(dilated(group, 4), (std::vector<std::string>{"aaaaaabbbbbb", "aaaaaabbbbbb"}));
}

TEST(ComposePage, TiesGoToTheFirstInRowOrderAndZeroFillsThePage) {
  const atlas::TextureGroup group = draw({"a..b", "....", "...."});
  EXPECT_EQ(dilated(group, 0), (std::vector<std::string>{"aabb", "aabb", "aabb"}));
  const atlas::TextureGroup odd = draw({"a.b", "...", "c.."});
  EXPECT_EQ(dilated(odd, 0), (std::vector<std::string>{"aab", "aab", "ccb"}));
}

TEST(ComposePage, RingsCountInTexelsAndNothingIsLitOnAnEmptyPage) {
  const atlas::TextureGroup group = draw({"a......"});
  EXPECT_EQ(dilated(group, 3), (std::vector<std::string>{"aaaa..."}));
  const image::PageImage empty = compose_page(draw({"...", "..."}), 0, at({}), 0);
  for (const math::Rgb v : empty.rgb) EXPECT_TRUE(is_black(v));
}

TEST(ComposePage, BilinearReadsNeverMeetTheOtherChartFromTwoEmptyTexelsOn) {
  // Charts of awkward shapes, two empty texels apart at the closest.
  const atlas::TextureGroup group =
      draw({"aaaaaaaa", "aa......", "aa......", "a....bbb", "....b...", "...bbb.b"});
  const auto rows = dilated(group, 0);
  const auto& page = group.pages[0];
  for (int y = 0; y < int(page.height); ++y)
    for (int x = 0; x < int(page.width); ++x) {
      const std::int32_t texel = page.texel_at[std::size_t(y) * page.width + x];
      if (texel < 0) continue;
      for (int ny = std::max(0, y - 1); ny <= std::min(int(page.height) - 1, y + 1); ++ny)
        for (int nx = std::max(0, x - 1); nx <= std::min(int(page.width) - 1, x + 1); ++nx)
          EXPECT_EQ(rows[ny][nx], char('a' + group.chart[texel])) << x << ' ' << y;
    }
}

TEST(ComposePage, LitTexelsKeepTheirValueAndPaddingHasNoCoverage) {
  const atlas::TextureGroup group = draw({"ab."});
  const std::vector<math::Rgb> values{{1, 2, 3}, {4, 5, 6}};
  const image::PageImage image = compose_page(group, 0, at(values), 4);
  EXPECT_EQ(image.rgb[0], values[0]);
  EXPECT_EQ(image.rgb[1], values[1]);
  EXPECT_EQ(image.rgb[2], values[1]);
  EXPECT_EQ(image.coverage, (std::vector<float>{0.5f, 0.5f, 0}));
}

image::PageImage row_of(const std::vector<float>& gray, float coverage = 1) {
  image::PageImage image{std::uint32_t(gray.size()), 1, {}, {}};
  for (const float g : gray) image.rgb.push_back({g, g, g});
  image.coverage.assign(gray.size(), coverage);
  return image;
}

TEST(ToneMap, ExposureBringsThe95thPercentileTo08) {
  std::vector<float> ramp;
  for (int i = 1; i <= 100; ++i) ramp.push_back(float(i) * 10);
  image::PageImage image = row_of(ramp);
  EXPECT_FLOAT_EQ(automatic_exposure(image), 0.8f / 950);
  image.rgb.push_back({1e6f, 1e6f, 1e6f});  // padding does not count
  image.coverage.push_back(0);
  EXPECT_FLOAT_EQ(automatic_exposure(image), 0.8f / 950);
}

TEST(ToneMap, BlackPagesAndLonelySpots) {
  EXPECT_EQ(automatic_exposure(row_of({0, 0, 0})), 1);
  EXPECT_EQ(automatic_exposure(row_of({5, 5}, 0)), 1);
  std::vector<float> spot(100, 0.f);
  spot[3] = 20;
  EXPECT_FLOAT_EQ(automatic_exposure(row_of(spot)), 0.8f / 20);
}

TEST(ToneMap, MonotoneFromBlackToWhiteAtFour) {
  std::vector<float> ramp;
  for (int i = 0; i <= 500; ++i) ramp.push_back(float(i) * 0.01f);
  const auto pixels = tone_map(row_of(ramp), {});
  EXPECT_EQ(pixels[0][0], 0);
  EXPECT_LT(pixels[390][0], 255);
  EXPECT_EQ(pixels[400][0], 255);
  for (std::size_t i = 1; i < pixels.size(); ++i) EXPECT_GE(pixels[i][0], pixels[i - 1][0]);
  // 0.8 * (1 + 0.8 / 16) / 1.8 = 0.46667, in sRGB 0.7132.
  EXPECT_EQ(tone_map(row_of({80}), {0.01f})[0][1], 182);
}

TEST(ToneMap, TheCurveOfAConstantGoesByTheBrightestValue) {
  image::PageImage image = row_of({200, 100, 10, 0});
  image.rgb.push_back({1e6f, 1e6f, 1e6f});  // padding does not count
  image.coverage.push_back(0);
  const Tone tone = tone_of(image, {}, 0.1f);
  EXPECT_EQ(tone.k, 0.1f);
  EXPECT_FLOAT_EQ(tone.exposure, 1 / 200.f);
  const auto pixels = tone_map(image, tone);
  EXPECT_EQ(pixels[0][0], 232) << "1 / 1.1 of 255, not scaled to white";
  EXPECT_EQ(pixels[1][0], 213) << "0.5 / 0.6";
  EXPECT_EQ(pixels[2][0], 85) << "0.05 / 0.15";
  EXPECT_EQ(pixels[3][0], 0);
  EXPECT_EQ(pixels[4][0], 255);
}

TEST(ToneMap, AnExposureThatIsGivenTakesTheUsualCurve) {
  const image::PageImage image = row_of({200, 100});
  EXPECT_EQ(tone_of(image, 0.5f, 0.1f).exposure, 0.5f);
  EXPECT_FALSE(tone_of(image, 0.5f, 0.1f).k);
  EXPECT_EQ(tone_of(image, {}, {}).exposure, automatic_exposure(image));
  EXPECT_EQ(tone_of(row_of({0, 0}), {}, 0.1f).exposure, 1);
  EXPECT_EQ(tone_of(row_of({5, 5}, 0), {}, 0.1f).exposure, 1);
}

TEST(ToneMap, NothingBreaksTheByteRange) {
  const float inf = std::numeric_limits<float>::infinity();
  const auto pixels = tone_map(row_of({-1, inf, std::nanf("")}), {});
  EXPECT_EQ(pixels[0][0], 0);
  EXPECT_EQ(pixels[1][0], 255);
  EXPECT_EQ(pixels[2][0], 0);
  const image::PageImage wild = row_of({-1, inf, std::nanf(""), 3});
  const Tone tone = tone_of(wild, {}, 0.02f);
  EXPECT_FLOAT_EQ(tone.exposure, 1 / 3.f);
  const auto curved = tone_map(wild, tone);
  EXPECT_EQ(curved[0][0], 0);
  EXPECT_EQ(curved[1][0], 255);
  EXPECT_EQ(curved[2][0], 0);
}

}  // namespace
}  // namespace kiln::output
