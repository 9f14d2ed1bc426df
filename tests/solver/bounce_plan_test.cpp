#include "baker/solver/gather/bounce_plan.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace kiln::solver {
namespace {

/// Reports of a room whose light grows by a geometric series: direct light of 1 lx, and bounces
/// that add ratio, ratio², ... to it.
class Room {
 public:
  explicit Room(double ratio) : ratio_(ratio), done_{pass(1, 1), pass(1, 0)} {}

  const std::vector<proto::PassReport>& done() const { return done_; }
  gather::BouncePlan plan(std::uint32_t bounces, float tolerance,
                          const sampling::DirectionSet& set) const {
    proto::SolverSettings settings;
    settings.bounces = bounces;
    settings.tolerance = tolerance;
    return {settings, set, kFirst};
  }
  void bounce() {
    const double added = std::pow(ratio_, double(done_.size() - kFirst + 1));
    light_ += added;
    done_.push_back(pass(light_, added / light_));
  }

 private:
  static constexpr std::uint32_t kFirst = 2;  // passes before the first bounce
  static proto::PassReport pass(double mean_lx, double residual) {
    proto::PassReport p;
    p.mean_lx = mean_lx, p.residual = residual;
    return p;
  }

  double ratio_, light_ = 1;
  std::vector<proto::PassReport> done_;
};

TEST(BouncePlan, TheLastBounceStandsForAllThatAreLeftOut) {
  const sampling::DirectionSet set(0, 256, false);
  Room room(0.5);
  const gather::BouncePlan plan = room.plan(100, 1e-3f, set);
  double light = 1;
  gather::BouncePlan::Bounce bounce;
  std::uint32_t count = 0;
  while (!(bounce = plan.next(room.done())).last) {
    light += std::pow(0.5, ++count);
    room.bounce();
  }
  ASSERT_TRUE(bounce.stands_for_others);
  EXPECT_LE(count, 10u);
  light += std::pow(0.5, count + 1) * (1 + bounce.tail_scale);
  EXPECT_NEAR(light, 2, 1e-9) << "the sum of the series";
}

TEST(BouncePlan, TheLimitEndsIt) {
  const sampling::DirectionSet set(0, 256, false);
  Room room(0.9);
  const gather::BouncePlan plan = room.plan(3, 0, set);
  for (int i = 0; i < 3; ++i) {
    const gather::BouncePlan::Bounce bounce = plan.next(room.done());
    EXPECT_FALSE(bounce.stands_for_others);
    EXPECT_EQ(bounce.last, i == 2);
    EXPECT_FALSE(plan.is_complete(room.done()));
    room.bounce();
  }
  EXPECT_TRUE(plan.is_complete(room.done()));
}

TEST(BouncePlan, FewerHitsAreReadTheLessIsAtStake) {
  const sampling::DirectionSet set(0, 256, false);
  Room room(0.5);
  const gather::BouncePlan plan = room.plan(100, 1e-9f, set);
  std::vector<std::uint32_t> read;
  for (int i = 0; i < 12; ++i) {
    read.push_back(plan.next(room.done()).directions);
    room.bounce();
  }
  EXPECT_EQ(read, (std::vector<std::uint32_t>{256, 256, 256, 128, 64, 32, 16, 16, 16, 16, 16, 16}));
  // Packets of a coherent set are parts of the hemisphere: all of them are needed.
  const sampling::DirectionSet coherent(0, 256, true);
  ASSERT_TRUE(coherent.coherent);
  EXPECT_EQ(room.plan(100, 1e-9f, coherent).next(room.done()).directions, 256u);
}

}  // namespace
}  // namespace kiln::solver
