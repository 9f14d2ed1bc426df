#include "server/jobs/job_queue.h"

#include <gtest/gtest.h>

#include <vector>

namespace kiln::jobs {
namespace {

std::vector<std::int64_t> take_all(JobQueue& queue, std::size_t max_running = 0) {
  std::vector<std::int64_t> order;
  while (const auto next = queue.take(max_running)) order.push_back(next->sequence);
  return order;
}

TEST(JobQueue, GoesByPriorityThenAge) {
  JobQueue queue;
  queue.insert({"a", 0, 1});
  queue.insert({"a", 5, 2});
  queue.insert({"a", -5, 3});
  queue.insert({"a", 5, 4});
  EXPECT_EQ(queue.size(), 4u);
  EXPECT_EQ(take_all(queue), (std::vector<std::int64_t>{2, 4, 1, 3}));
  EXPECT_EQ(queue.running(), 4u);
  EXPECT_EQ(queue.size(), 0u);
}

TEST(JobQueue, ATenantWithManyJobsDoesNotKeepOthersWaiting) {
  JobQueue queue;
  for (int i = 1; i <= 5; ++i) queue.insert({"many", 0, i});
  queue.insert({"few", 0, 6});
  queue.insert({"few", 0, 7});
  EXPECT_EQ(take_all(queue), (std::vector<std::int64_t>{1, 6, 2, 7, 3, 4, 5}));
  queue.insert({"many", 0, 8});
  queue.insert({"few", 0, 9});
  for (int i = 0; i < 5; ++i) queue.release("many");
  EXPECT_EQ(queue.take(0)->sequence, 8) << "two of the other still run";
}

TEST(JobQueue, HoldsATenantAtItsLimit) {
  JobQueue queue;
  for (int i = 1; i <= 3; ++i) queue.insert({"a", 100, i});
  queue.insert({"b", 0, 4});
  EXPECT_EQ(take_all(queue, 2), (std::vector<std::int64_t>{1, 2, 4}));
  EXPECT_EQ(queue.waiting("a"), 1u);
  queue.release("a");
  EXPECT_EQ(queue.take(2)->sequence, 3);
}

TEST(JobQueue, WhatFindsNoMemoryIsNotPassed) {
  JobQueue queue;
  queue.insert({"a", 0, 1, 100});
  queue.insert({"a", 0, 2, 10});
  queue.insert({"b", 0, 3});
  EXPECT_FALSE(queue.take(0, 99)) << "not the small ones either: the large one would wait for ever";
  EXPECT_EQ(queue.size(), 3u);
  EXPECT_EQ(queue.take(0, 100)->sequence, 1);
  EXPECT_EQ(queue.take(0, 0)->sequence, 3) << "how much it needs is not known yet";
  EXPECT_FALSE(queue.take(0, 9));
  EXPECT_EQ(queue.take(0, 10)->bytes, 10u);
}

TEST(JobQueue, KnowsPlacesByPriorityAndAge) {
  JobQueue queue;
  const JobQueue::Entry first{"a", 0, 1}, second{"b", 0, 2}, late{"a", 5, 3}, none{"a", 0, 4};
  for (const auto& entry : {second, first, late}) queue.insert(entry);
  EXPECT_EQ(queue.position(late), 1u);
  EXPECT_EQ(queue.position(first), 2u);
  EXPECT_EQ(queue.position(second), 3u);
  EXPECT_EQ(queue.position(none), 0u);
  queue.insert(first);  // is there already
  EXPECT_EQ(queue.position(second), 3u);
  EXPECT_EQ(queue.take(0)->sequence, 3);
  EXPECT_EQ(queue.position(late), 0u);
  EXPECT_EQ(queue.position(second), 2u);
  queue.erase(first);
  EXPECT_EQ(queue.position(second), 1u);
}

TEST(JobQueue, ForgetsWhatIsErased) {
  JobQueue queue;
  queue.insert({"a", 1, 1});
  EXPECT_TRUE(queue.contains({"a", 1, 1}));
  EXPECT_FALSE(queue.contains({"a", 2, 1}));
  EXPECT_FALSE(queue.contains({"b", 1, 1}));
  EXPECT_FALSE(queue.erase({"a", 1, 2}));
  EXPECT_TRUE(queue.erase({"a", 1, 1}));
  EXPECT_FALSE(queue.erase({"a", 1, 1}));
  EXPECT_EQ(queue.waiting("a"), 0u);
  EXPECT_FALSE(queue.take(0));
}

}  // namespace
}  // namespace kiln::jobs
