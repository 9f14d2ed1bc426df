#include "baker/sampling/direction_set.h"

#include <gtest/gtest.h>

#include <bit>
#include <vector>

namespace kiln::sampling {
namespace {

/// Points in each cell of a grid of 2^x_bits by 2^y_bits.
std::vector<int> counts(const DirectionSet& set, int x_bits, int y_bits) {
  std::vector<int> n(std::size_t(1) << (x_bits + y_bits));
  for (std::uint32_t i = 0; i < set.size(); ++i) {
    const std::uint32_t x = x_bits > 0 ? set.x[i] >> (32 - x_bits) : 0,
                        y = y_bits > 0 ? set.y[i] >> (32 - y_bits) : 0;
    ++n[x << y_bits | y];
  }
  return n;
}

// A (1,m,2)-net: every elementary interval of two points' volume holds two.
TEST(DirectionSet, ItsLeadingDirectionsAreSpreadAsWell) {
  const DirectionSet all(0, 256, false);
  for (std::uint32_t n = 256; n >= 16; n /= 2) {
    const DirectionSet some = all.leading(n);
    ASSERT_EQ(some.size(), n);
    const int bits = std::countr_zero(n) - 1;
    for (int x_bits = 0; x_bits <= bits; ++x_bits)
      for (const int c : counts(some, x_bits, bits - x_bits)) ASSERT_EQ(c, 2) << n << " of 256";
  }
}

TEST(DirectionSet, HalvesOfItsLeadingDirectionsAreHalvesOfAll) {
  const DirectionSet all(0, 128, false), some = all.leading(32);
  int second = 0;
  for (std::uint32_t i = 0; i < some.size(); ++i) {
    EXPECT_EQ(some.in_second_half(i), all.in_second_half(i));
    second += some.in_second_half(i);
  }
  EXPECT_EQ(second, 16);
  // The mean of 32 directions, of which 16 bring 1 and 16 bring 3.
  const Estimate e = some.estimate(math::Rgb{16, 16, 16}, math::Rgb{48, 48, 48});
  EXPECT_FLOAT_EQ(e.mean.g, 2);
  EXPECT_NEAR(e.half_difference, -kNetCorrection, 1e-5) << "half the difference, as of a net";
  const DirectionSet chance(0, 32, false, false);
  EXPECT_NEAR(chance.estimate(math::Rgb{16, 16, 16}, math::Rgb{48, 48, 48}).half_difference, -1,
              1e-5);
}

}  // namespace
}  // namespace kiln::sampling
