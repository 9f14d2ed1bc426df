#include <gtest/gtest.h>
#include <sys/socket.h>

#include <atomic>
#include <chrono>
#include <future>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "tests/http/live.h"
#include "tests/support/sanitizer.h"

/// Requests that wait for a job hold no thread: there may be hundreds.
namespace kiln::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

constexpr unsigned kThreads = 8;

class Waiters : public testing::Test {
 protected:
  static base::ServerConfig config() {
    base::ServerConfig config;
    config.http_threads = kThreads;
    config.max_running_jobs = 1;
    return config;
  }
  static std::string get(const std::string& target) {
    return "GET " + target + " HTTP/1.1\r\nHost: x\r\n\r\n";
  }
  static std::string metrics(const Live& live) {
    return ask(live.service->admin_port(), "GET", "/metrics").body;
  }
  static void expect_metric(const Live& live, const std::string& line) {
    const auto late = Clock::now() + seconds(20);
    std::string all;
    while (all.find("\n" + line + "\n") == std::string::npos && Clock::now() < late) {
      std::this_thread::sleep_for(milliseconds(5));
      all = metrics(live);
    }
    EXPECT_NE(all.find("\n" + line + "\n"), std::string::npos) << line << "\n" << all;
  }
  static void expect_waiting(const Live& live, std::size_t count) {
    expect_metric(live, "http_waiting " + std::to_string(count));
  }
  static void add_waiters(const Live& live, std::size_t count, const std::string& target,
                          std::vector<Wire>& wires) {
    for (std::size_t i = 0; i < count; ++i) {
      wires.emplace_back(live.port());
      EXPECT_TRUE(wires.back().send(get(target)));
    }
    expect_waiting(live, wires.size());
  }
  static std::vector<Wire> waiters(const Live& live, std::size_t count, const std::string& target) {
    std::vector<Wire> wires;
    add_waiters(live, count, target, wires);
    return wires;
  }
  /// One answer, with a body of the length that it names.
  static Answer read_answer(const Wire& wire, bool has_body = true) {
    Answer answer;
    std::string text = wire.read("\r\n\r\n", seconds(30));
    if (!read_head(text, answer)) return answer;
    answer.body = text.substr(text.find("\r\n\r\n") + 4);
    if (!has_body || answer.status == 304) return answer;
    const auto length = std::stoul(answer.headers.at("content-length"));
    while (answer.body.size() < length) {
      const std::string more = wire.read(answer.body.empty() ? "}" : "", milliseconds(100));
      if (more.empty()) break;
      answer.body += more;
    }
    return answer;
  }
  /// A job that waits behind one that runs until `fake_.go`.
  std::string queued_job(const Live& live) {
    const std::string running = post_job(live.port());
    EXPECT_EQ(wait_for_state(live.port(), running, "running"), "running");
    return post_job(live.port());
  }

  /// A service whose checks are refused as long as `busy`.
  Live live_with_checks(const std::atomic<bool>& busy, std::atomic<int>& checks) {
    const auto check = [&](const files::SceneFiles&,
                           const proto::BakeSettings&) -> proto::Expected<void> {
      ++checks;
      if (busy) return proto::fail("overloaded", "Too many scenes are being read at once.");
      return {};
    };
    return Live(fake_.instant(), config(), {}, check);
  }

  jobs::FakeBake fake_;
};

// A burst of uploads is worked off, not refused.
TEST_F(Waiters, UploadsWaitForTheirTurnToBeRead) {
  std::atomic<bool> busy{true};
  std::atomic<int> checks{0};
  const Live live = live_with_checks(busy, checks);
  const std::string body = form({{"name=\"scene\"; filename=\"a.glb\"", "glTF"},
                                 {"name=\"options\"", R"({"dedupe":false})"}});
  const std::string post = "POST /v1/jobs HTTP/1.1\r\nHost: x\r\n" + kForm +
                           "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
  std::vector<Wire> wires;
  for (unsigned i = 0; i < 5 * kThreads; ++i) {
    wires.emplace_back(live.port());
    ASSERT_TRUE(wires.back().send(post));
  }
  expect_waiting(live, wires.size());
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200) << "none of them holds a thread";
  const int before = checks;
  std::this_thread::sleep_for(seconds(1));
  EXPECT_LE(checks - before, int(10 * wires.size())) << "nor turns in a circle";
  busy = false;
  for (const Wire& wire : wires) EXPECT_EQ(read_answer(wire).status, 202);
}

TEST_F(Waiters, UploadsThatWaitAreToldOfTheEnd) {
  const std::atomic<bool> busy{true};
  std::atomic<int> checks{0};
  const Live live = live_with_checks(busy, checks);
  const Wire wire(live.port());
  ASSERT_TRUE(
      wire.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\n"
                "Content-Type: model/gltf-binary\r\n\r\nglTF"));
  expect_waiting(live, 1);
  auto stopped = std::async(std::launch::async, [&] { live.service->stop(seconds(20)); });
  EXPECT_EQ(read_answer(wire).status, 503);
  stopped.get();
}

TEST_F(Waiters, FiveHundredHearOfTheEndAndNobodyElseWaits) {
  const Live live(fake_.holding(), config());
  const std::string id = post_job(live.port());
  ASSERT_EQ(wait_for_state(live.port(), id, "running"), "running");
  const auto wires = waiters(live, 500, "/v1/jobs/" + id + "?wait=60");
  const auto begin = Clock::now();
  for (int round = 0; round < 5; ++round) {
    EXPECT_EQ(ask(live.service->admin_port(), "GET", "/healthz").status, 200);
    EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/" + id).status, 200) << "a thread is free";
    EXPECT_EQ(post_job(live.port()).substr(0, 4), "job_");
  }
  EXPECT_LT(Clock::now() - begin, seconds(5) * kSlowdown) << "a wait is sixty";
  expect_waiting(live, 500);

  fake_.go = true;
  ASSERT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  const auto over = Clock::now();
  std::set<std::string> requests;
  for (const Wire& wire : wires) {
    const Answer answer = read_answer(wire);
    ASSERT_EQ(answer.status, 200);
    EXPECT_EQ(member(answer.body, "state"), "succeeded");
    requests.insert(answer.headers.at("x-request-id"));
  }
  EXPECT_LT(Clock::now() - over, seconds(1) * kSlowdown);
  EXPECT_EQ(requests.size(), 500u);
  expect_waiting(live, 0);
  // They are kept alive.
  EXPECT_TRUE(wires.back().send(get("/v1/jobs/" + id)));
  EXPECT_EQ(read_answer(wires.back()).status, 200);
}

// A pool that is told of more waiters than may queue for it refuses none of them.
TEST_F(Waiters, AreNotRefusedWhenAllAreWokenAtOnce) {
  http::EdgeLimits limits;
  limits.waiting = 4;
  const Live live(fake_.holding(), config(), limits);
  const std::string id = queued_job(live);
  std::vector<Wire> wires;
  for (int i = 0; i < 50; ++i) add_waiters(live, 4, "/v1/jobs/" + id + "?wait=60", wires);
  EXPECT_EQ(ask(live.port(), "POST", "/v1/jobs/" + id + "/cancel").status, 202);
  for (const Wire& wire : wires) EXPECT_EQ(read_answer(wire).status, 200);
  fake_.go = true;
}

TEST_F(Waiters, AreAnsweredWithTheJobAsItIsWhenTheTimeIsUp) {
  const Live live(fake_.holding(), config());
  const std::string path = "/v1/jobs/" + queued_job(live);
  const std::string version = member(ask(live.port(), "GET", path).body, "version");
  const auto began = Clock::now();
  const auto wires = waiters(live, 20, path + "?wait=1");
  for (const Wire& wire : wires) {
    const Answer answer = read_answer(wire);
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(member(answer.body, "state"), "queued");
    EXPECT_EQ(member(answer.body, "version"), version);
    EXPECT_EQ(answer.headers.at("etag"), "\"" + version + "\"");
  }
  EXPECT_GE(Clock::now() - began, milliseconds(1000));
  EXPECT_LT(Clock::now() - began, seconds(4) * kSlowdown);
  fake_.go = true;
}

TEST_F(Waiters, KeepTheSemanticsOfTheirRequest) {
  base::ServerConfig limited = config();
  limited.max_requests_per_minute_per_tenant = 1000;
  const Live live(fake_.holding(), limited);
  const std::string path = "/v1/jobs/" + queued_job(live);
  const std::string version = member(ask(live.port(), "GET", path).body, "version");
  const Wire head(live.port()), known(live.port()), submit(live.port());
  head.send("HEAD " + path + "?wait=1 HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  known.send("GET " + path + "?wait=1 HTTP/1.1\r\nHost: x\r\nIf-None-Match: \"" + version +
             "\"\r\n\r\n");
  submit.send(
      "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: model/gltf-binary\r\n"
      "Prefer: wait=1\r\nContent-Length: 4\r\n\r\nglTF");
  const Answer headed = read_answer(head, /*has_body=*/false);
  EXPECT_EQ(headed.status, 200);
  EXPECT_TRUE(headed.body.empty());
  EXPECT_EQ(headed.headers.at("connection"), "close");
  EXPECT_TRUE(headed.headers.contains("ratelimit")) << "what is said with every answer";
  EXPECT_TRUE(head.closed(seconds(5)));
  EXPECT_EQ(read_answer(known).status, 304);
  const Answer going = read_answer(submit);
  EXPECT_EQ(going.status, 202);
  EXPECT_EQ(going.headers.at("preference-applied"), "wait=1");
  EXPECT_TRUE(submit.send(get("/v1/jobs/" + member(going.body, "id"))));
  EXPECT_EQ(read_answer(submit).status, 200) << "on the same connection";
  fake_.go = true;
}

TEST_F(Waiters, ThatGoGiveTheirPlaceBack) {
  base::ServerConfig few = config();
  few.max_connections = 12;
  const Live live(fake_.holding(), few);
  const std::string id = queued_job(live);
  auto wires = waiters(live, 12, "/v1/jobs/" + id + "?wait=60");
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/" + id).status, 503) << "all places are taken";
  while (wires.size() > 4) wires.pop_back();
  expect_waiting(live, 4);
  expect_metric(live, R"(http_requests_total{code="499",method="GET",route="/v1/jobs/{}"} 8)");
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/" + id).status, 200);
  EXPECT_EQ(ask(live.port(), "POST", "/v1/jobs/" + id + "/cancel").status, 202);
  for (const Wire& wire : wires) EXPECT_EQ(read_answer(wire).status, 200);
  fake_.go = true;
}

TEST_F(Waiters, OfWhomNothingMoreCanComeAreDropped) {
  const Live live(fake_.holding(), config());
  const std::string id = queued_job(live);
  const auto wires = waiters(live, 3, "/v1/jobs/" + id + "?wait=60");
  wires[0].finish();
  wires[1].send(get("/v1/jobs/" + id).substr(0, 20));  // with bytes that nobody reads
  wires[1].finish();
  EXPECT_TRUE(wires[0].closed(seconds(10)));
  EXPECT_TRUE(wires[1].closed(seconds(10)));
  expect_waiting(live, 1);
  fake_.go = true;
  EXPECT_EQ(read_answer(wires[2]).status, 200);
}

TEST_F(Waiters, AreAnsweredBeforeWhatTheySendMeanwhile) {
  const Live live(fake_.holding(), config());
  const std::string id = queued_job(live);
  const std::string wait = get("/v1/jobs/" + id + "?wait=60"), next = get("/v1/jobs/job_none");
  const Wire ahead(live.port()), slow(live.port());
  const std::string last =
      "HEAD /v1/jobs/" + id + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";
  ASSERT_TRUE(ahead.send(wait + next + last));
  ASSERT_TRUE(slow.send(wait));
  expect_waiting(live, 2);
  for (const char byte : next) {
    ASSERT_TRUE(slow.send({&byte, 1}));
    std::this_thread::sleep_for(milliseconds(2));
  }
  EXPECT_TRUE(ahead.read("\n", milliseconds(100)).empty());
  EXPECT_EQ(ask(live.port(), "POST", "/v1/jobs/" + id + "/cancel").status, 202);
  const std::string three = ahead.read({}, seconds(30));  // to the end
  const auto first = three.find("\"canceled\""), second = three.find("HTTP/1.1 404");
  EXPECT_LT(first, second) << three;
  EXPECT_LT(second, three.rfind("HTTP/1.1 200")) << three;
  const std::string both = slow.read("HTTP/1.1 404", seconds(10));
  ASSERT_NE(both.find("HTTP/1.1 404"), std::string::npos) << both;
  EXPECT_LT(both.find("\"canceled\""), both.find("HTTP/1.1 404")) << both;
  fake_.go = true;
}

TEST_F(Waiters, AreAllAnsweredWhenTheServiceEnds) {
  const Live live(fake_.holding(), config());
  const std::string id = queued_job(live);
  const auto wires = waiters(live, 300, "/v1/jobs/" + id + "?wait=60");
  const auto began = Clock::now();
  auto stopped = std::async(std::launch::async, [&] { live.service->stop(seconds(20)); });
  for (const Wire& wire : wires) {
    const Answer answer = read_answer(wire);
    ASSERT_EQ(answer.status, 200);
    EXPECT_EQ(member(answer.body, "state"), "queued");
    EXPECT_EQ(answer.headers.at("connection"), "close");
  }
  stopped.get();
  EXPECT_LT(Clock::now() - began, seconds(5) * kSlowdown);
}

// Between the look at the job and the waiting it may change: nobody must sleep through that.
TEST_F(Waiters, MissNoChange) {
  const Live live(fake_.holding(), config());
  const std::string path = "/v1/jobs/" + queued_job(live);
  std::atomic<bool> done{false};
  std::thread changer([&] {
    for (int i = 0; !done; ++i)
      EXPECT_EQ(ask(live.port(), "PATCH", path, {"Content-Type: application/json"},
                    R"({"labels":{"n":")" + std::to_string(i) + R"("}})")
                    .status,
                200);
  });
  const auto follow = [&] {
    const Wire wire(live.port());
    std::string version = "0";
    for (int i = 0; i < 50; ++i) {
      const auto asked = Clock::now();
      wire.send(get(path + "?wait=60&since=" + version));
      const Answer answer = read_answer(wire);
      ASSERT_EQ(answer.status, 200);
      EXPECT_LT(Clock::now() - asked, seconds(20)) << "after version " << version;
      version = member(answer.body, "version");
    }
  };
  std::vector<std::future<void>> followers;
  for (int i = 0; i < 4; ++i) followers.push_back(std::async(std::launch::async, follow));
  for (auto& follower : followers) follower.get();
  done = true;
  changer.join();
  fake_.go = true;
}

}  // namespace
}  // namespace kiln::test
