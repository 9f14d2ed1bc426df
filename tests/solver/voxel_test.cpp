// Voxels in the place of rays: what the two kinds of grids and marches see, and what they miss.
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "baker/trace/visibility.h"
#include "tests/solver/cornell_box.h"
#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver {
namespace {

using trace::VoxelFill;
using trace::VoxelGrid;
using trace::VoxelVisibility;

VoxelGrid grid_of(const scene::Scene& scene, std::uint32_t voxels, VoxelFill fill) {
  return test::must(VoxelGrid::build(scene, voxels, fill));
}

/// Random points within the Cornell box.
class Points {
 public:
  math::Vec3 next() { return {coordinate(), 1 + coordinate(), coordinate()}; }

 private:
  float coordinate() { return std::uniform_real_distribution<float>(-0.99f, 0.99f)(random_); }
  std::mt19937 random_{7};
};

math::Vec3 middle_of(const scene::Scene& scene, std::uint32_t triangle, float u, float v) {
  return position_at(scene, triangle, {u, v});
}

TEST(Voxels, EveryPointOfASurfaceLiesInASolidOne) {
  const auto box = cornell(16);
  const VoxelGrid grid = grid_of(box->scene(), 32, VoxelFill::kConservative);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0, 1);
  for (std::uint32_t t = 0; t < box->scene().triangles.size(); ++t)
    for (int i = 0; i < 200; ++i) {
      float u = unit(random), v = unit(random);
      if (u + v > 1) u = 1 - u, v = 1 - v;
      // Rounding may put the point just beyond the face of a voxel that the triangle lies in.
      const math::Vec3 p = middle_of(box->scene(), t, u, v);
      const float e = 1e-4f * grid.voxel_m();
      bool near = false;
      for (int k = 0; k < 8 && !near; ++k)
        near = grid.is_solid(p + math::Vec3{k & 1 ? e : -e, k & 2 ? e : -e, k & 4 ? e : -e});
      ASSERT_TRUE(near) << t;
    }
}

TEST(Voxels, HaveNumbersOfTheirOwn) {
  const auto box = cornell(16);
  const VoxelGrid grid = grid_of(box->scene(), 8, VoxelFill::kConservative);
  const float side = grid.voxel_m();
  ASSERT_FLOAT_EQ(side, 0.25f) << "the box reaches from -1, 0, -1 to 1, 2, 1";
  std::set<std::uint32_t> numbers;
  for (int x = 0; x < 8; ++x)
    for (int y = 0; y < 8; ++y)
      for (int z = 0; z < 8; ++z) {
        const math::Vec3 low{float(x) * side - 1, float(y) * side, float(z) * side - 1};
        const auto at = [&](float share) { return low + math::Vec3{side, side, side} * share; };
        const std::uint32_t voxel = grid.voxel_of(at(0.1f));
        EXPECT_EQ(grid.voxel_of(at(0.9f)), voxel);
        EXPECT_EQ(grid.is_solid_voxel(voxel), grid.is_solid(at(0.5f)));
        numbers.insert(voxel);
      }
  EXPECT_EQ(numbers.size(), 512u);
  EXPECT_EQ(grid.voxel_of({-1.001f, 1.1f, 0.1f}), grid.voxel_of({-0.9f, 1.1f, 0.1f}))
      << "a point that rounding took out of the grid";
}

TEST(Voxels, TheRasterizersGridIsPartOfTheConservativeOne) {
  const auto box = cornell(16);
  const std::uint64_t some = grid_of(box->scene(), 32, VoxelFill::kDominantAxis).solid_voxels();
  const std::uint64_t all = grid_of(box->scene(), 32, VoxelFill::kConservative).solid_voxels();
  EXPECT_LT(some, all);
  // Six walls take 32² voxels each, and two blocks somewhat more.
  EXPECT_GT(some, 5u * 32 * 32);
  EXPECT_LT(all, 12u * 32 * 32);
}

TEST(Voxels, AMarchVisitsWhatASegmentTouches) {
  const auto box = cornell(16);
  const VoxelGrid grid = grid_of(box->scene(), 24, VoxelFill::kConservative);
  Points points;
  std::uint32_t met = 0;
  for (int i = 0; i < 3000; ++i) {
    const math::Vec3 from = points.next(), to = points.next();
    const bool meets = grid.meets(from, to);
    met += meets;
    if (grid.meets_at_steps(from, to, 500)) {
      ASSERT_TRUE(meets) << i;
    }
    ASSERT_EQ(meets, grid.meets(to, from)) << i;
  }
  EXPECT_GT(met, 0u);
  EXPECT_LT(met, 3000u);
}

TEST(Voxels, NothingThatBlocksARayIsMissedByTheExactMarch) {
  const auto box = cornell(16);
  const trace::RayScene rays = test::must(trace::RayScene::build(box->scene()));
  const VoxelGrid grid = grid_of(box->scene(), 32, VoxelFill::kConservative);
  Points points;
  std::uint32_t blocked = 0;
  for (int i = 0; i < 3000; ++i) {
    trace::SegmentPacket packet;
    const math::Vec3 from = points.next(), to = points.next();
    packet.add(from, to);
    if (trace::RayVisibility(rays).blocked(packet) == 0) continue;
    ++blocked;
    ASSERT_TRUE(grid.meets(from, to)) << i;
  }
  EXPECT_GT(blocked, 100u);
}

class March : public testing::Test {
 protected:
  std::unique_ptr<QuadScene> box_ = cornell(16);
  trace::RayScene rays_ = test::must(trace::RayScene::build(box_->scene()));

  /// Returns the share of random segments of which the voxels say what rays say.
  double agreement(VoxelFill fill, VoxelVisibility::March march, std::uint32_t voxels,
                   float ratio = 1) {
    const VoxelVisibility visibility(grid_of(box_->scene(), voxels, fill), march, ratio, rays_);
    const trace::RayVisibility exact(rays_);
    Points points;
    std::uint32_t same = 0;
    constexpr std::uint32_t kPackets = 400;
    for (std::uint32_t i = 0; i < kPackets; ++i) {
      trace::SegmentPacket packet;
      while (!packet.is_full()) packet.add(points.next(), points.next());
      same += std::popcount(~(visibility.blocked(packet) ^ exact.blocked(packet)) & 0xffffu);
    }
    return same / (16.0 * kPackets);
  }
};

TEST_F(March, FinerVoxelsAgreeMoreOftenWithRays) {
  using enum VoxelVisibility::March;
  const double coarse = agreement(VoxelFill::kConservative, kExact, 16);
  const double fine = agreement(VoxelFill::kConservative, kExact, 128);
  RecordProperty("agreement", std::to_string(coarse) + ", " + std::to_string(fine));
  EXPECT_GT(fine, coarse);
  EXPECT_GT(fine, 0.9);
}

TEST_F(March, TheRatioSaysHowManySegmentsAreTraced) {
  using enum VoxelVisibility::March;
  EXPECT_EQ(agreement(VoxelFill::kConservative, kExact, 16, 0), 1) << "all of them are rays";
  const double none = agreement(VoxelFill::kConservative, kExact, 16, 1);
  const double half = agreement(VoxelFill::kConservative, kExact, 16, 0.5f);
  // Half of the disagreements are left, within four standard deviations of their number.
  const double expected = (1 - none) / 2;
  EXPECT_NEAR(1 - half, expected, 4 * std::sqrt(expected / 6400));
}

}  // namespace
}  // namespace kiln::solver
