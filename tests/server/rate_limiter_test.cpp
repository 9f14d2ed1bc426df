#include "server/auth/rate_limiter.h"

#include <gtest/gtest.h>

namespace kiln::auth {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const RateLimiter::Clock::time_point kStart{};

TEST(RateLimiter, GivesAMinutesWorthAtOnceThenAnEvenShare) {
  RateLimiter limiter(60);
  for (std::uint32_t left = 60; left-- > 0;) {
    const auto state = limiter.take("a", kStart);
    EXPECT_TRUE(state.allowed);
    EXPECT_EQ(state.remaining, left);
    EXPECT_EQ(state.reset, 60 - left);
  }
  const auto refused = limiter.take("a", kStart);
  EXPECT_FALSE(refused.allowed);
  EXPECT_EQ(refused.limit, 60u);
  EXPECT_EQ(refused.retry, 1u);
  EXPECT_FALSE(limiter.take("a", kStart + milliseconds(900)).allowed) << "a refusal costs nothing";
  EXPECT_TRUE(limiter.take("a", kStart + milliseconds(1'100)).allowed);
  EXPECT_FALSE(limiter.take("a", kStart + milliseconds(1'200)).allowed);
  const auto full = limiter.take("a", kStart + seconds(600));
  EXPECT_EQ(full.remaining, 59u) << "never more than a minute's worth";
}

TEST(RateLimiter, CountsEachKeyByItself) {
  RateLimiter limiter(1);
  EXPECT_TRUE(limiter.take("a", kStart).allowed);
  EXPECT_TRUE(limiter.take("b", kStart).allowed);
  const auto refused = limiter.take("a", kStart + seconds(20));
  EXPECT_FALSE(refused.allowed);
  EXPECT_EQ(refused.retry, 40u);
}

TEST(RateLimiter, WithoutALimitAllowsEverything) {
  RateLimiter limiter(0);
  for (int i = 0; i < 10'000; ++i) EXPECT_TRUE(limiter.take("a", kStart).allowed);
  EXPECT_FALSE(limiter.take("a", kStart).limited);
}

TEST(RateLimiter, IsNotConfusedByAClockThatStands) {
  RateLimiter limiter(60);
  limiter.take("a", kStart + seconds(10));
  EXPECT_EQ(limiter.take("a", kStart).remaining, 58u) << "a thread that was late";
  EXPECT_EQ(limiter.take("a", kStart + seconds(10)).remaining, 57u);
}

}  // namespace
}  // namespace kiln::auth
