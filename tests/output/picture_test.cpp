// The colors of a layer's pictures.
#include "baker/output/picture.h"

#include <gtest/gtest.h>

#include <cmath>

#include "baker/output/post.h"

namespace kiln::output {
namespace {

using Code = std::array<std::uint8_t, 3>;

Code shown(math::Rgb value, Shown way, Tone tone = {}, const ValueRange& range = {}) {
  return show({1, 1, {value}, {1}}, way, tone, range).at(0);
}

TEST(Picture, FiguresAreCodesInProportion) {
  EXPECT_EQ(shown({0, 0.5f, 1}, Shown::kShare), (Code{0, 128, 255}));
  EXPECT_EQ(shown({-1, 0, 1}, Shown::kSigned), (Code{0, 128, 255}));
  ValueRange range;
  range.add({-2, 0, 10});
  range.add({2, 5, 10});
  EXPECT_EQ(shown({0, 5, 10}, Shown::kWithinBounds, {}, range), (Code{128, 255, 0}))
      << "a channel of one value has no extent";
  EXPECT_EQ(shown({0, 5, 10}, Shown::kOverMaximum, {}, range), (Code{0, 128, 255}));
}

TEST(Picture, ColorsAreSrgb) {
  EXPECT_EQ(shown({0, 0.2158605f, 1}, Shown::kColor), (Code{0, 128, 255}));  // IEC 61966-2-1
  EXPECT_EQ(shown({-1, 2, 0}, Shown::kColor), (Code{0, 255, 0}));
}

TEST(Picture, LightHasTheToneCurveOfPreviews) {
  const image::PageImage image{1, 1, {{3, 1, 0.1f}}, {1}};
  for (const Shown way : {Shown::kPageLight, Shown::kOwnLight})
    for (const Tone tone : {Tone{0.5f}, Tone{0.5f, 0.1f}})
      EXPECT_EQ(show(image, way, tone, {}), tone_map(image, tone));
}

TEST(Picture, WhatIsNoNumberIsBlack) {
  const float nan = std::nanf(""), inf = INFINITY;
  EXPECT_EQ(shown({nan, nan, nan}, Shown::kPageLight, {1, 0.1f}), (Code{0, 0, 0}));
  for (const Shown way : {Shown::kPageLight, Shown::kColor, Shown::kShare, Shown::kSigned,
                          Shown::kOverMaximum, Shown::kWithinBounds}) {
    ValueRange range;
    range.add({0, 0, 0});
    range.add({1, 1, 1});
    EXPECT_EQ(shown({nan, nan, nan}, way, {}, range), (Code{0, 0, 0})) << int(way);
  }
  ValueRange endless;
  endless.add({-inf, -inf, -inf});
  endless.add({inf, inf, inf});
  EXPECT_EQ(shown({1, 2, 3}, Shown::kWithinBounds, {}, endless), (Code{0, 0, 0}));
}

}  // namespace
}  // namespace kiln::output
