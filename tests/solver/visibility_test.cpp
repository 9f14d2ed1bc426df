// Whether two points see each other, and how near to them something may stand.
#include "baker/trace/visibility.h"

#include <gtest/gtest.h>

#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver {
namespace {

class Visible : public testing::Test {
 protected:
  QuadScene scene_{16};
  std::optional<trace::RayScene> rays_;

  void build() {
    scene_.build();
    rays_.emplace(test::must(trace::RayScene::build(scene_.scene())));
  }
  bool is_blocked(math::Vec3 from, math::Vec3 to) const {
    trace::SegmentPacket packet;
    packet.add(from, to);
    return trace::RayVisibility(*rays_).blocked(packet) == 1;
  }
};

TEST_F(Visible, WhatStandsBetweenBlocksFromEitherSide) {
  scene_.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  build();
  EXPECT_TRUE(is_blocked({0, 1, 0}, {0, -1, 0}));
  EXPECT_TRUE(is_blocked({0, -1, 0}, {0, 1, 0}));
  EXPECT_FALSE(is_blocked({0, 1, 0}, {0, 0.5f, 0})) << "it lies beyond the end";
  EXPECT_FALSE(is_blocked({0, 0.5f, 0}, {0, 1, 0})) << "it lies before the beginning";
  EXPECT_FALSE(is_blocked({3, 1, 0}, {3, -1, 0}));
}

// The ends may lie on surfaces: a ray keeps off both of them by the same distance.
TEST_F(Visible, NeitherEndIsInTheWay) {
  scene_.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  scene_.add({{-1, 1, -1}, {2, 0, 0}, {0, 0, 2}});
  build();
  const float epsilon = rays_->offset({0, 1, 0});
  ASSERT_GT(epsilon, 0);
  ASSERT_LT(epsilon, 1e-4f);
  EXPECT_FALSE(is_blocked({0.1f, 0, 0.2f}, {-0.3f, 1, 0.1f}));
  EXPECT_FALSE(is_blocked({-0.3f, 1, 0.1f}, {0.1f, 0, 0.2f}));
  // Beyond an end by less than that there is nothing in the way either, by more there is.
  EXPECT_FALSE(is_blocked({0.1f, -0.5f * epsilon, 0}, {0.1f, 1 + 0.5f * epsilon, 0}));
  EXPECT_TRUE(is_blocked({0.1f, -2 * epsilon, 0}, {0.1f, 0.5f, 0}));
  EXPECT_TRUE(is_blocked({0.1f, 0.5f, 0}, {0.1f, 1 + 2 * epsilon, 0}));
  // What is shorter than both margins is open.
  EXPECT_FALSE(is_blocked({0, -0.9f * epsilon, 0}, {0, 0.9f * epsilon, 0}));
  EXPECT_FALSE(is_blocked({0.5f, 0.5f, 0.5f}, {0.5f, 0.5f, 0.5f}));
}

TEST_F(Visible, EachSegmentHasItsBit) {
  scene_.add({{0, 0, -1}, {0, 0, 2}, {4, 0, 0}});
  build();
  trace::SegmentPacket packet;
  std::uint32_t expected = 0;
  for (std::uint32_t i = 0; i < 16; ++i) {
    const float x = 0.5f * float(i) - 2.25f;  // over the sheet from 0 to 4
    packet.add({x, 1, 0}, {x, -1, 0});
    expected |= std::uint32_t(x > 0 && x < 4) << i;
  }
  EXPECT_TRUE(packet.is_full());
  EXPECT_EQ(trace::RayVisibility(*rays_).blocked(packet), expected);
  packet.count = 7;
  EXPECT_EQ(trace::RayVisibility(*rays_).blocked(packet), expected & 0x7f);
}

}  // namespace
}  // namespace kiln::solver
