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
  constexpr std::uint64_t kAllowed = 24ull << 20;  // it keeps 20 MiB; without a trim 28 or more
  const TempFolder folder;
  Program program(folder.path() / "data");
  const auto scene = write_scene(folder.path(), "cornell");
  ask(program.port(), "GET", "/v1/jobs");
  const std::uint64_t before = program.anonymous_bytes();
  std::uint64_t peak = 0;
  for (int i = 0; i < 20; ++i) {
    const std::string settings =
        R"({"atlas":{"page_size":256},"solver":{"samples":16,"seed":)" + std::to_string(i) + "}}";
    const std::string id = post_job(program, scene, settings);
    EXPECT_EQ(wait_for_state(program.port(), id, "succeeded"), "succeeded");
    peak = std::max(peak, program.anonymous_bytes());
  }
  ASSERT_GT(peak, before + kAllowed) << "the burst shows nothing";
  const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (program.anonymous_bytes() > before + kAllowed && std::chrono::steady_clock::now() < late)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_LE(program.anonymous_bytes(), before + kAllowed) << "of " << peak;
}

}  // namespace
}  // namespace kiln::test
