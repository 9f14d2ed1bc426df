#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "tests/http/program.h"
#include "tests/support/sanitizer.h"

/// What a burst of jobs took is given back.
namespace kiln::test {
namespace {

TEST(IdleMemory, ShrinksAfterABurstOfSmallJobs) {
  if (kSlowdown > 1) GTEST_SKIP() << "a sanitizer's allocator keeps what was freed";
  constexpr std::uint64_t kAllowed = 28ull << 20;  // without a trim it keeps 39 MiB
  const TempFolder folder;
  Program program(folder.path() / "data");
  const auto scene = write_scene(folder.path(), "cornell");
  const auto bake = [&](int seed) {
    const std::string settings = R"({"atlas":{"page_size":256},"solver":{"samples":16,"seed":)" +
                                 std::to_string(seed) + "}}";
    const std::string id = post_job(program, scene, settings);
    EXPECT_EQ(wait_for_state(program.port(), id, "succeeded"), "succeeded");
  };
  const auto settle = [&](std::uint64_t to) {
    const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (program.anonymous_bytes() > to && std::chrono::steady_clock::now() < late)
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return program.anonymous_bytes();
  };
  // The first page that is written opens the image module, which stays open.
  bake(0);
  std::this_thread::sleep_for(std::chrono::seconds(5));
  const std::uint64_t before = program.anonymous_bytes();
  std::uint64_t peak = 0;
  for (int seed = 1; seed <= 20; ++seed) {
    bake(seed);
    peak = std::max(peak, program.anonymous_bytes());
  }
  const std::uint64_t after = settle(before + kAllowed);
  EXPECT_LE(after, before + kAllowed) << "of " << peak << ", before " << before;
}

}  // namespace
}  // namespace kiln::test
