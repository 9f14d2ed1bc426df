#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <thread>

#include "tests/http/live.h"
#include "tests/http/program.h"
#include "tests/support/sanitizer.h"

/// The admin port, which cpp-httplib serves, and bytes that a well-behaved client never sends.
namespace kiln::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

TEST(AdminPort, AnswersItsPagesAndNothingElse) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::uint16_t port = live.service->admin_port();
  const Answer health = ask(port, "GET", "/healthz");
  EXPECT_EQ(health.status, 200);
  EXPECT_EQ(member(health.body, "status"), "ok");
  EXPECT_TRUE(health.headers.contains("x-request-id"));
  EXPECT_EQ(ask(port, "HEAD", "/healthz").status, 200);
  EXPECT_TRUE(ask(port, "HEAD", "/healthz").body.empty());
  const Answer none = ask(port, "GET", "/v1/jobs");
  EXPECT_EQ(none.status, 404);
  EXPECT_EQ(member(none.body, "code"), "not_found");
  const Answer post = ask(port, "POST", "/healthz", {kForm}, form({{"name=\"x\"", "y"}}));
  EXPECT_EQ(post.status, 405);
  EXPECT_EQ(member(post.body, "code"), "method_not_allowed");
  EXPECT_EQ(post.headers.at("allow"), "GET, HEAD");
}

TEST(AdminPort, SurvivesHostileHeads) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::uint16_t port = live.service->admin_port();
  std::string ranges = "Range: bytes=0-1", parts = "Content-Type: multipart/form-data; boundary=";
  for (int i = 0; i < 1'500; ++i) ranges += ",0-1";
  for (const std::string& header :
       {ranges, parts + std::string(8'000, 'B'), "A: " + std::string(100'000, 'a'),
        std::string("Content-Length: 99999999999"), std::string("Transfer-Encoding: chunked")}) {
    const Wire wire(port);
    wire.send("GET /healthz HTTP/1.1\r\nHost: x\r\n" + header + "\r\n\r\n");
    wire.read("\r\n\r\n", seconds(3));
  }
  EXPECT_EQ(ask(port, "GET", "/healthz").status, 200);
}

// Neither idle connections nor slow heads keep others from their answers for long.
TEST(AdminPort, SlowClientsAreCut) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::uint16_t port = live.service->admin_port();
  std::vector<Wire> idle, slow;
  for (int i = 0; i < 100; ++i) idle.emplace_back(port);
  for (int i = 0; i < 40; ++i) {
    slow.emplace_back(port);
    slow.back().send("GET /healthz HTTP/1.1\r\nHost:");
  }
  std::atomic<bool> done{false};
  std::thread trickle([&] {
    while (!done) {
      for (const Wire& wire : slow) wire.send("x");
      std::this_thread::sleep_for(milliseconds(100));
    }
  });
  const auto began = Clock::now();
  EXPECT_EQ(ask(port, "GET", "/healthz").status, 200);
  EXPECT_LT(Clock::now() - began, seconds(4) * kSlowdown);
  EXPECT_TRUE(slow.front().closed(seconds(4) * kSlowdown));
  done = true;
  trickle.join();
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200);
}

TEST(AdminPort, AnEndlessHeadTakesLittleMemory) {
  if (kSlowdown > 1) GTEST_SKIP() << "a sanitizer's allocator keeps what was freed";
  const TempFolder folder;
  Program program(folder.path() / "data");
  ask(program.admin_port(), "GET", "/metrics");
  const std::uint64_t before = program.anonymous_bytes();
  const Wire wire(program.admin_port());
  wire.send("GET /healthz HTTP/1.1\r\nA: ");
  std::thread sender([&] {
    const std::string bytes(1'000, 'x');
    while (wire.send(bytes)) continue;
  });
  std::uint64_t peak = 0;
  const auto began = Clock::now();
  bool open = true;
  while (open && Clock::now() - began < seconds(20)) {
    open = !wire.closed(milliseconds(20));
    peak = std::max(peak, program.anonymous_bytes());
  }
  EXPECT_FALSE(open);
  EXPECT_LT(Clock::now() - began, seconds(8));
  wire.finish();
  sender.join();
  EXPECT_LT(peak, before + (64ull << 20));
  EXPECT_EQ(ask(program.admin_port(), "GET", "/healthz").status, 200);
}

}  // namespace
}  // namespace kiln::test
