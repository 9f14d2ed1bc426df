#include <gtest/gtest.h>

#include "tests/http/live.h"

/// Bytes that a well-behaved client never sends, said to a live service.
namespace kiln::test {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

std::size_t answers(const std::string& text) {
  const std::string mark = "\r\nX-Request-Id: ";
  std::size_t count = 0;
  for (auto at = text.find(mark); at != std::string::npos; at = text.find(mark, at + 1)) ++count;
  return count;
}

constexpr const char* kSecond = "GET /v1/capabilities HTTP/1.1\r\nHost: x\r\n\r\n";

// Whoever sees other message borders than the next server can hide a request in a body. All of
// these get one answer, and the connection ends.
TEST(Edge, DisagreementAboutFramingEndsTheConnection) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::string smuggled = kSecond, size = std::to_string(smuggled.size());
  for (const auto& [head, status] : std::vector<std::pair<std::string, std::string>>{
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 0\r\nContent-Length: " + size,
            "400"},
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: " + size + ", " + size, "400"},
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: +" + size, "400"},
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: " + size +
                "\r\nTransfer-Encoding: chunked",
            "400"},
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked, identity", "400"},
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding : chunked", "400"},
           {"GET /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: " + size, "400"},
           {"GET /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked", "400"},
           {"GET /v1/jobs HTTP/1.1\r\nHost: x\r\nHost: y", "400"},
           {"GET /v1/jobs HTTP/1.1\r\nHost: x\r\nA: b\r\n c: d", "400"},
           {"GET /v1/jobs HTTP/1.1\nHost: x", "400"},
           {"GET /v1/jobs HTTP/2.0\r\nHost: x", "400"},
           {"POST /nothing HTTP/1.1\r\nHost: x\r\nContent-Length: " + size, "404"},
           {"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: text/plain\r\nContent-Length: " +
                size,
            "415"},
           {"PUT /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked", "405"},
       }) {
    const Wire wire(live.port());
    wire.send(head + "\r\n\r\n" + smuggled);
    const std::string text = wire.read();
    EXPECT_TRUE(text.starts_with("HTTP/1.1 " + status)) << head << "\n" << text;
    EXPECT_EQ(answers(text), 1u) << head << "\n" << text;
    EXPECT_NE(text.find("Connection: close"), std::string::npos) << head;
  }
}

TEST(Edge, ABodyThatWasReadLeavesTheConnectionUsable) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const Wire wire(live.port());
  const std::string body = "{\"scene\":1}", chunked = "b\r\n" + body + "\r\n0\r\n\r\n";
  const std::string head =
      "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n";
  wire.send(head + "Content-Length: 11\r\n\r\n" + body + head +
            "Transfer-Encoding: chunked\r\n\r\n" + chunked +
            "GET /v1/jobs?limit=7 HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  const std::string text = wire.read();
  EXPECT_EQ(answers(text), 3u) << text;
  EXPECT_EQ(text.find("HTTP/1.1 400"), std::string::npos) << text;
  EXPECT_NE(text.find("\"next_cursor\""), std::string::npos) << text;
}

TEST(Edge, ChunksThatAreNoneEndTheConnection) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  for (const std::string body : {"zz\r\nabc", "-3\r\nabc\r\n", "3\nabc\r\n0\r\n\r\n",
                                 "ffffffffffffffffff\r\n", "3\r\nabcd\r\n0\r\n\r\n"}) {
    const Wire wire(live.port());
    wire.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n" + body);
    const std::string text = wire.read();
    EXPECT_TRUE(text.starts_with("HTTP/1.1 400")) << body << "\n" << text;
    EXPECT_EQ(answers(text), 1u) << body;
  }
}

TEST(Edge, ASlowHeadMeetsItsDeadline) {
  jobs::FakeBake fake;
  http::EdgeLimits limits;
  limits.head_deadline = milliseconds(300);
  limits.keep_alive = milliseconds(300);
  const Live live(fake.instant(), {}, limits);
  const auto began = Clock::now();
  const Wire silent(live.port()), slow(live.port()), kept(live.port());
  slow.send("GET / HTTP/1.1\r\nHost:");
  kept.send("GET /v1/jobs HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_TRUE(kept.read("next_cursor").starts_with("HTTP/1.1 200"));
  std::string late;
  while (late.empty() && Clock::now() - began < std::chrono::seconds(5)) {
    slow.send("x");  // a byte now and then does not help
    late = slow.read("\r\n\r\n", milliseconds(50));
  }
  EXPECT_TRUE(late.starts_with("HTTP/1.1 408")) << late;
  EXPECT_TRUE(silent.read().empty());
  EXPECT_TRUE(silent.closed(milliseconds(1000)));
  EXPECT_TRUE(kept.closed(milliseconds(1000)));
  EXPECT_GE(Clock::now() - began, milliseconds(300));
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(2));
}

TEST(Edge, ASlowBodyMeetsItsDeadline) {
  jobs::FakeBake fake;
  http::EdgeLimits limits;
  limits.read_idle = milliseconds(200);
  limits.rate_grace = milliseconds(400);
  const Live live(fake.instant(), {}, limits);
  const std::string head = "POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Length: 100000\r\n\r\n";
  const auto began = Clock::now();
  const Wire stuck(live.port()), trickle(live.port());
  stuck.send(head + "glTF");
  trickle.send(head + "glTF");
  std::string late;
  while (late.empty() && Clock::now() - began < std::chrono::seconds(5)) {
    trickle.send("x");
    late = trickle.read("\r\n\r\n", milliseconds(50));
  }
  EXPECT_TRUE(late.starts_with("HTTP/1.1 400")) << late;
  EXPECT_GE(Clock::now() - began, limits.rate_grace);
  EXPECT_TRUE(stuck.read().starts_with("HTTP/1.1 400"));
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(2));
  EXPECT_TRUE(std::filesystem::is_empty(live.folder.path() / "data" / "tmp"));
}

TEST(Edge, AnEndlessHeadIsCutOff) {
  jobs::FakeBake fake;
  http::EdgeLimits limits;
  limits.linger = milliseconds(300);
  const Live live(fake.instant(), {}, limits);
  const Wire wire(live.port());
  wire.send("GET / HTTP/1.1\r\n");
  const auto began = Clock::now();
  const auto time = [&] { return Clock::now() - began; };
  while (time() < std::chrono::seconds(5) && wire.send(std::string(100'000, 'x'))) {
  }
  EXPECT_LT(time(), std::chrono::seconds(2));
  const Wire many(live.port());
  std::string head = "GET / HTTP/1.1\r\nHost: x\r\n";
  for (int i = 0; i < 200; ++i) head += "A: b\r\n";
  many.send(head + "\r\n");
  EXPECT_TRUE(many.read().starts_with("HTTP/1.1 431"));
  const Wire large(live.port());
  large.send("GET / HTTP/1.1\r\nHost: x\r\nA: " + std::string(40'000, 'a'));
  EXPECT_TRUE(large.read().starts_with("HTTP/1.1 431"));
  EXPECT_EQ(ask(live.port(), "GET", "/" + std::string(600, 'p')).status, 414);
}

TEST(Edge, TooManyConnectionsAreToldSo) {
  jobs::FakeBake fake;
  http::EdgeLimits limits;
  limits.connections = 3;
  const Live live(fake.instant(), {}, limits);
  std::vector<Wire> idle;
  for (int i = 0; i < 3; ++i) idle.emplace_back(live.port());
  const Wire fourth(live.port());
  const std::string text = fourth.read();
  EXPECT_TRUE(text.starts_with("HTTP/1.1 503")) << text;
  EXPECT_NE(text.find("\"overloaded\""), std::string::npos);
  EXPECT_NE(text.find("Retry-After: "), std::string::npos);
  // Those who came first are served, and who leaves makes room.
  idle[0].send("GET /v1/jobs HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  EXPECT_TRUE(idle[0].read().starts_with("HTTP/1.1 200"));
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200);
}

TEST(Edge, WaitingRequestsLeaveThreadsForOthers) {
  jobs::FakeBake fake;
  base::ServerConfig config;
  config.http_threads = 2;
  const Live live(fake.holding(), config);
  const std::string id = post_job(live.port());
  std::vector<Wire> waiting;
  for (int i = 0; i < 8; ++i) {
    waiting.emplace_back(live.port());
    waiting.back().send("GET /v1/jobs/" + id + "?wait=60 HTTP/1.1\r\nHost: x\r\n\r\n");
  }
  const auto began = Clock::now();
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200);
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(5));
  fake.go = true;
  for (const Wire& wire : waiting) EXPECT_TRUE(wire.read("\r\n\r\n").starts_with("HTTP/1.1 200"));
}

TEST(Edge, AFullQueueIsToldSo) {
  jobs::FakeBake fake;
  base::ServerConfig config;
  config.max_running_jobs = 1;
  config.max_queued_jobs = 1;
  const Live live(fake.holding(), config);
  const std::string running = post_job(live.port());
  ASSERT_EQ(wait_for_state(live.port(), running, "running"), "running");
  const std::string queued = post_job(live.port());
  const Answer third = ask(live.port(), "POST", "/v1/jobs", {kForm},
                           form({{"name=\"scene\"; filename=\"a.glb\"", "glTF"}}));
  EXPECT_EQ(third.status, 503);
  EXPECT_EQ(member(third.body, "code"), "queue_full");
  EXPECT_TRUE(third.headers.contains("retry-after"));
  fake.go = true;
  EXPECT_EQ(wait_for_state(live.port(), queued, "succeeded"), "succeeded");
}

}  // namespace
}  // namespace kiln::test
