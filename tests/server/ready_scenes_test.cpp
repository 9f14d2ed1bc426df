#include "server/ready_scenes.h"

#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <thread>
#include <vector>

#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

/// The scenes that requests of visibility share, and what they take of the memory.
namespace kiln::server {
namespace {

using namespace std::chrono_literals;
using proto::Expected;

constexpr std::uint64_t kBudget = std::uint64_t{1} << 30;
constexpr auto kSoon = 20s;

void wait_until(const std::function<bool()>& there) {
  const auto deadline = std::chrono::steady_clock::now() + kSoon;
  while (!there() && std::chrono::steady_clock::now() < deadline) std::this_thread::sleep_for(1ms);
  ASSERT_TRUE(there());
}

/// A tree of some quads.
trace::RayScene build(std::uint32_t quads) {
  solver::QuadScene scene(128);
  for (std::uint32_t i = 0; i < quads; ++i) scene.add({{float(i), 0, 0}, {0.5f, 0, 0}, {0, 0, 1}});
  scene.build();
  return test::must(trace::RayScene::build(scene.scene()));
}

class Scenes : public testing::Test {
 protected:
  const std::uint64_t bytes_ = build(1).memory_bytes();  ///< of each scene that make_ gives
  std::shared_ptr<base::MemoryBudget> memory_ = std::make_shared<base::MemoryBudget>(kBudget);
  std::shared_ptr<ReadyScenes> scenes_ = ReadyScenes::create(memory_, 2 * bytes_ + bytes_ / 2);
  std::atomic<int> made_{0};
  std::atomic<bool> holds_{false};

  Expected<trace::RayScene> make(const ReadyScenes::Reserve& reserve, const std::stop_token& stop) {
    ++made_;
    while (holds_ && !stop.stop_requested()) std::this_thread::sleep_for(1ms);
    if (stop.stop_requested()) return proto::canceled();
    if (!reserve(10 * bytes_)) return proto::fail("overloaded", "There is no memory.");
    return build(1);
  }
  Expected<ReadyScenes::Use> get(const std::string& key, const std::stop_token& stop = {}) {
    return scenes_->get(
        key, [this](const auto& reserve, const auto& token) { return make(reserve, token); }, stop);
  }
  /// Asks for scenes one after the other, and returns how many of them had to be made.
  int made_of(const std::vector<std::string>& keys) {
    const int before = made_;
    for (const auto& key : keys) EXPECT_TRUE(get(key)) << key;
    return made_ - before;
  }
};

TEST_F(Scenes, AreKeptForTheNextRequest) {
  {
    const auto first = get("a"), second = get("a");
    ASSERT_TRUE(first && second);
    EXPECT_FALSE(first->was_ready);
    EXPECT_TRUE(second->was_ready);
    EXPECT_EQ(first->rays, second->rays);
    EXPECT_EQ(memory_->reserved(), bytes_) << "no more than the tree";
    EXPECT_EQ(scenes_->kept_bytes(), 0u) << "it is in use";
  }
  EXPECT_EQ(scenes_->kept_bytes(), bytes_);
  EXPECT_TRUE(get("a")->was_ready);
  EXPECT_EQ(made_, 1);
}

TEST_F(Scenes, TheLastUsedOnesStayWithinTheBudget) {
  EXPECT_EQ(made_of({"a", "b", "a", "b"}), 2);
  EXPECT_EQ(made_of({"a", "c"}), 1) << "b was not used for longest, and goes";
  EXPECT_EQ(made_of({"a", "c"}), 0);
  EXPECT_EQ(made_of({"b", "a"}), 2) << "of three that are used in turn none is there";
  EXPECT_EQ(scenes_->kept_bytes(), 2 * bytes_);
  EXPECT_EQ(memory_->reserved(), 2 * bytes_);
  scenes_.reset();
  EXPECT_EQ(memory_->reserved(), 0u);
}

TEST_F(Scenes, OneThatIsUsedLivesOn) {
  auto used = get("a");
  ASSERT_TRUE(used);
  EXPECT_EQ(made_of({"b", "c", "d", "b", "c", "d"}), 6);
  EXPECT_EQ(memory_->reserved(), 3 * bytes_) << "it counts beside those that are kept";
  EXPECT_EQ(get("a")->rays, used->rays);
  scenes_.reset();
  trace::RayPacket ray;
  ray.set(0, {0.2f, 1, 0.5f}, {0, -1, 0}, 2);
  ray.activate_first(1);
  EXPECT_EQ(used->rays->occluded(ray), 1u) << "even without the others";
  used = proto::canceled();
  EXPECT_EQ(memory_->reserved(), 0u);
}

TEST_F(Scenes, OneThatIsTooLargeDoesNotSendTheOthersAway) {
  EXPECT_EQ(made_of({"a", "b"}), 2);
  const auto large = [](const auto&, const auto&) -> Expected<trace::RayScene> {
    return test::must(trace::RayScene::build(test::ReadyScene("bumpy_ball", 0, 64).scene));
  };
  {
    const auto use = scenes_->get("large", large, {});
    ASSERT_TRUE(use);
    ASSERT_GT(use->rays->memory_bytes(), 3 * bytes_);
  }
  EXPECT_EQ(memory_->reserved(), 2 * bytes_);
  EXPECT_EQ(made_of({"a", "b"}), 0);
}

TEST_F(Scenes, NothingIsKeptWithoutABudget) {
  scenes_ = ReadyScenes::create(memory_, 0);
  EXPECT_EQ(made_of({"a", "a"}), 2);
  EXPECT_EQ(memory_->reserved(), 0u);
}

TEST_F(Scenes, ManyRequestsTogetherMakeItOnce) {
  holds_ = true;
  std::atomic<int> same{0};
  std::vector<std::jthread> requests;
  for (int i = 0; i < 8; ++i) requests.emplace_back([&] { same += get("a").has_value(); });
  wait_until([&] { return made_ == 1; });
  std::this_thread::sleep_for(50ms);
  holds_ = false;
  requests.clear();
  EXPECT_EQ(same, 8);
  EXPECT_EQ(made_, 1);
}

TEST_F(Scenes, MakingGoesOnForThoseWhoStay) {
  holds_ = true;
  std::stop_source first, second;
  std::optional<Expected<ReadyScenes::Use>> one, two, three;
  std::jthread maker([&] { one = get("a", first.get_token()); });
  wait_until([&] { return made_ == 1; });
  std::jthread waits([&] { two = get("a", second.get_token()); });
  std::jthread stays([&] { three = get("a"); });
  std::this_thread::sleep_for(50ms);
  first.request_stop();
  second.request_stop();
  waits.join();
  EXPECT_EQ(two->error().code, proto::kCanceledCode) << "at once";
  EXPECT_EQ(made_, 1);
  holds_ = false;
  maker.join();
  stays.join();
  EXPECT_EQ(one->error().code, proto::kCanceledCode);
  EXPECT_TRUE(*three);
  EXPECT_EQ(made_, 1);
}

TEST_F(Scenes, MakingStopsWhenAllHaveLeft) {
  holds_ = true;
  std::stop_source first, second;
  std::jthread maker([&] { EXPECT_FALSE(get("a", first.get_token())); });
  wait_until([&] { return made_ == 1; });
  std::jthread waits([&] { EXPECT_FALSE(get("a", second.get_token())); });
  std::this_thread::sleep_for(50ms);
  first.request_stop();
  second.request_stop();
  maker.join();  // though it holds
  waits.join();
  EXPECT_EQ(memory_->reserved(), 0u);
  holds_ = false;
  EXPECT_EQ(made_of({"a"}), 1) << "the next makes it anew";
}

TEST_F(Scenes, FailuresAreToldAndForgotten) {
  const auto broken = [&](const auto&, const auto&) -> Expected<trace::RayScene> {
    ++made_;
    while (holds_) std::this_thread::sleep_for(1ms);
    return proto::fail("invalid_image", "It is damaged.");
  };
  holds_ = true;
  std::atomic<int> told{0};
  std::vector<std::jthread> requests;
  for (int i = 0; i < 3; ++i)
    requests.emplace_back([&] {
      const auto use = scenes_->get("a", broken, {});
      told += !use && use.error().code == "invalid_image";
    });
  wait_until([&] { return made_ == 1; });
  std::this_thread::sleep_for(50ms);
  holds_ = false;
  requests.clear();
  EXPECT_EQ(told, 3);
  EXPECT_EQ(made_, 1);
  const auto throws = [](const auto& reserve, const auto&) -> Expected<trace::RayScene> {
    EXPECT_TRUE(reserve(100));
    throw std::bad_alloc();
  };
  EXPECT_THROW(scenes_->get("a", throws, {}), std::bad_alloc);
  EXPECT_EQ(memory_->reserved(), 0u);
  EXPECT_EQ(made_of({"a"}), 1);
}

TEST_F(Scenes, WhoNeedsTheMemoryIsGivenWhatIsKept) {
  EXPECT_EQ(made_of({"a", "b"}), 2);
  EXPECT_EQ(memory_->free_bytes(), kBudget) << "kept ones are as good as free";
  ASSERT_TRUE(memory_->reserve("job", kBudget - bytes_));
  EXPECT_EQ(scenes_->kept_bytes(), bytes_) << "one was enough";
  EXPECT_EQ(made_of({"b"}), 0) << "the one that was used last";
  {
    const auto used = get("b");
    EXPECT_FALSE(memory_->reserve("job", kBudget)) << "not one that is used";
    std::atomic<int> told{0};
    memory_->on_free([&] { ++told; });
    EXPECT_EQ(get("c").error().code, "overloaded");
    EXPECT_GE(told, 1);
  }
  EXPECT_TRUE(memory_->reserve("job", kBudget));
  EXPECT_EQ(scenes_->kept_bytes(), 0u);
  memory_->on_free({});
}

TEST_F(Scenes, AnImportThatWaitsIsGivenItAsWell) {
  memory_ = std::make_shared<base::MemoryBudget>(
      kBudget, base::MemoryBudget::Imports{2, kBudget, kBudget / 16});
  scenes_ = ReadyScenes::create(memory_, kBudget);
  auto used = get("a");
  ASSERT_TRUE(used);
  EXPECT_EQ(made_of({"b"}), 1);
  std::atomic<bool> in{false};
  std::jthread import([&] { in = memory_->enter(kBudget, {}).has_value(); });
  wait_until([&] { return scenes_->kept_bytes() == 0; });
  std::this_thread::sleep_for(20ms);
  EXPECT_FALSE(in) << "a is in use";
  used = proto::canceled();
  wait_until([&] { return in.load(); });
  EXPECT_EQ(scenes_->kept_bytes(), 0u);
}

}  // namespace
}  // namespace kiln::server
