#include "server/http/worker_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <latch>

namespace kiln::http {
namespace {

TEST(WorkerPool, RefusesWhatItCanNotHoldAndRunsWhatItTook) {
  std::latch started(1), go(1);
  std::atomic<int> ran{0};
  {
    WorkerPool pool(1, /*max_waiting=*/2);
    ASSERT_TRUE(pool.enqueue([&] {
      started.count_down();
      go.wait();
      ++ran;
    }));
    started.wait();
    EXPECT_TRUE(pool.enqueue([&] { ++ran; }));
    EXPECT_TRUE(pool.enqueue([&] { ++ran; }));
    EXPECT_FALSE(pool.enqueue([&] { ++ran; }));
    for (int i = 0; i < 5; ++i) pool.enqueue_again([&] { ++ran; });
    go.count_down();
  }
  EXPECT_EQ(ran, 8) << "what was taken before is never refused";
}

}  // namespace
}  // namespace kiln::http
