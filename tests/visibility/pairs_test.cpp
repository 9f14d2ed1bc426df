// Which of many pairs of points see each other.
#include "baker/visibility/pairs.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "baker/import/import.h"
#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::visibility {
namespace {

using math::Vec3;
using solver::QuadScene;

std::string bytes_of(const std::vector<std::pair<Vec3, Vec3>>& pairs) {
  static_assert(sizeof(std::pair<Vec3, Vec3>) == kPairBytes);
  return {reinterpret_cast<const char*>(pairs.data()), pairs.size() * kPairBytes};
}

bool bit_of(const std::string& bits, std::size_t pair) {
  return (static_cast<unsigned char>(bits[pair / 8]) >> pair % 8 & 1) != 0;
}

/// A closed room of 4 x 2 x 2 m around the origin, cut by a thin wall at x = 0 that leaves a gap of
/// 0.5 m under the ceiling.
class WalledRoom : public testing::Test {
 protected:
  static constexpr float kTop = 0.5f;  ///< of the wall; the room reaches from -1 to 1
  QuadScene scene_{32};
  std::optional<trace::RayScene> rays_;
  exec::ThreadPool pool_{2};
  const exec::Workers workers_{pool_, {}};

  void SetUp() override {
    scene_.add_room({-2, -1, -1}, {2, 1, 1}, {0.5f, 0.5f, 0.5f});
    scene_.add({{0, -1, -1}, {0, 1 + kTop, 0}, {0, 0, 2}});
    scene_.build();
    rays_.emplace(test::must(trace::RayScene::build(scene_.scene())));
  }

  /// The answer by geometry for points within the room; nothing where a hair decides.
  static std::optional<bool> expected(Vec3 a, Vec3 b) {
    constexpr float kHair = 1e-4f;
    if (std::abs(a.x) < kHair || std::abs(b.x) < kHair) return std::nullopt;
    if (a.x * b.x > 0) return true;
    const float y = a.y + (b.y - a.y) * (a.x / (a.x - b.x));  // over the wall's plane
    if (std::abs(y - kTop) < kHair) return std::nullopt;
    return y > kTop;
  }
  static std::vector<std::pair<Vec3, Vec3>> random_pairs(std::size_t count) {
    std::mt19937 random(1);
    std::uniform_real_distribution<float> x(-2, 2), other(-1, 1);
    std::vector<std::pair<Vec3, Vec3>> pairs(count);
    for (auto& [a, b] : pairs) {
      a = {x(random), other(random), other(random)};
      b = {x(random), other(random), other(random)};
    }
    return pairs;
  }
  std::string pointer_of(const std::string& bytes, std::uint64_t first = 0) const {
    const auto checked = check_pairs(bytes, workers_, first);
    if (checked) return "fine";
    EXPECT_EQ(checked.error().code, "invalid_request");
    return checked.error().details.at(0).pointer;
  }
};

TEST_F(WalledRoom, PairsAreAnsweredAsGeometryHasIt) {
  const auto pairs = random_pairs(100'003);
  const auto answer = test::must(see(*rays_, bytes_of(pairs), workers_));
  ASSERT_EQ(answer.bits.size(), answer_bytes(pairs.size()));
  std::size_t sure = 0, wrong = 0, open = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    open += bit_of(answer.bits, i);
    const auto right = expected(pairs[i].first, pairs[i].second);
    if (!right) continue;
    ++sure;
    wrong += *right != bit_of(answer.bits, i);
  }
  EXPECT_EQ(wrong, 0u);
  EXPECT_GT(sure, pairs.size() * 99 / 100);
  EXPECT_EQ(answer.visible, open);
  EXPECT_GT(open, pairs.size() / 4);
  EXPECT_LT(open, pairs.size() * 3 / 4);
}

TEST_F(WalledRoom, BitsStandInOrderAndTheRestIsZero) {
  const Vec3 left{-1, 0, 0}, right{1, 0, 0}, near{-0.5f, 0, 0};
  std::vector<std::pair<Vec3, Vec3>> pairs(19, {left, right});
  EXPECT_EQ(test::must(see(*rays_, bytes_of(pairs), workers_)).bits, std::string(3, '\0'));
  for (const std::size_t i : {0u, 3u, 9u, 15u, 16u, 18u}) pairs[i].second = near;
  const auto some = test::must(see(*rays_, bytes_of(pairs), workers_));
  EXPECT_EQ(some.bits, "\x09\x82\x05");
  EXPECT_EQ(some.visible, 6u);
  pairs.assign(19, {left, near});
  EXPECT_EQ(test::must(see(*rays_, bytes_of(pairs), workers_)).bits, "\xff\xff\x07");
  EXPECT_EQ(test::must(see(*rays_, "", workers_)).bits, "");
}

// Every count: whatever is left of a packet, of a byte and of a batch.
TEST_F(WalledRoom, BitsHangOnNeitherThreadsNorNeighbors) {
  const auto pairs = random_pairs(9'001);
  const std::string bytes = bytes_of(pairs);
  const auto all = test::must(see(*rays_, bytes, workers_));
  for (const unsigned threads : {1u, 3u, 8u}) {
    exec::ThreadPool pool(threads);
    EXPECT_EQ(test::must(see(*rays_, bytes, {pool, {}})).bits, all.bits) << threads;
  }
  for (std::size_t count = 1; count <= 40; ++count) {
    const auto some =
        test::must(see(*rays_, std::string_view(bytes).substr(0, count * kPairBytes), workers_));
    for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(bit_of(some.bits, i), bit_of(all.bits, i));
  }
}

TEST_F(WalledRoom, PointsOfSurfacesAndFarAwayHaveAnswers) {
  const Vec3 floor{-1, -1, 0}, ceiling{-1, 1, 0}, beyond{1, -1, 0};
  const auto answer = test::must(see(*rays_,
                                     bytes_of({{floor, ceiling},
                                               {floor, beyond},
                                               {floor, floor},
                                               {{1e12f, 1e12f, 1e12f}, {-1e12f, -1e12f, -1e12f}},
                                               {{1e12f, 0, 0}, {1e12f, 1e-38f, 0}}}),
                                     workers_));
  EXPECT_TRUE(bit_of(answer.bits, 0)) << "both are surfaces";
  EXPECT_FALSE(bit_of(answer.bits, 1)) << "the wall stands between";
  EXPECT_TRUE(bit_of(answer.bits, 2)) << "a point sees itself";
  EXPECT_TRUE(bit_of(answer.bits, 4));
}

TEST_F(WalledRoom, WrongPairsAreNamed) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  auto pairs = random_pairs(20'000);
  EXPECT_EQ(pointer_of(bytes_of(pairs)), "fine");
  EXPECT_EQ(pointer_of(""), "fine");
  EXPECT_EQ(pointer_of(bytes_of(pairs).substr(1)), "/body");
  EXPECT_EQ(pointer_of("x"), "/body");
  EXPECT_EQ(pointer_of(std::string((kMostPairs + 1) * kPairBytes, '\0')), "/body");
  EXPECT_EQ(pointer_of(std::string(kMostPairs * kPairBytes, '\0')), "fine");
  pairs[19'999].second.z = -kInfinity;
  EXPECT_EQ(pointer_of(bytes_of(pairs)), "/body/19999/5");
  EXPECT_EQ(pointer_of(bytes_of(pairs), 3'000'000), "/body/3019999/5");
  pairs[5'000].first.y = -1.0001e12f;
  EXPECT_EQ(pointer_of(bytes_of(pairs)), "/body/5000/1") << "the first of them";
  pairs[17].first.x = kNan;
  EXPECT_EQ(pointer_of(bytes_of(pairs)), "/body/17/0");
  pairs[17].first.x = std::numeric_limits<float>::denorm_min();
  EXPECT_EQ(pointer_of(bytes_of(pairs)), "/body/5000/1");
}

TEST_F(WalledRoom, AStopIsHeardWithinASecond) {
  const std::string bytes = bytes_of(random_pairs(kMostPairs));
  std::stop_source stop;
  const exec::Workers workers{pool_, stop.get_token()};
  std::chrono::steady_clock::time_point asked;
  std::jthread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    asked = std::chrono::steady_clock::now();
    stop.request_stop();
  });
  proto::Expected<Answer> answer;
  do answer = see(*rays_, bytes, workers);
  while (answer);
  const auto ended = std::chrono::steady_clock::now();
  later.join();
  EXPECT_EQ(answer.error().code, proto::kCanceledCode);
  EXPECT_LT(ended - asked, std::chrono::seconds(1));
  EXPECT_EQ(check_pairs(bytes, workers).error().code, proto::kCanceledCode);
}

// What a service reserves for a tree is more than is taken, and not many times as much.
TEST(RaySceneMemory, IsForeseenAndTold) {
  for (const char* name : {"cornell", "bumpy_ball"}) {
    const test::SceneFile file(name);
    const auto scene = test::must(import::import_files(file.files(), {}));
    const auto rays = test::must(trace::RayScene::build(scene));
    EXPECT_GT(rays.memory_bytes(), scene.triangles.size() * 60) << name;
    EXPECT_LE(rays.memory_bytes(), trace::RayScene::build_bytes(scene)) << name;
    if (scene.triangles.size() < 10'000) continue;  // blocks of the allocator
    EXPECT_GT(rays.memory_bytes() * 4, trace::RayScene::build_bytes(scene)) << name;
  }
}

}  // namespace
}  // namespace kiln::visibility
