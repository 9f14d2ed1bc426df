#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>

#include "tests/http/event_stream.h"
#include "tests/http/program.h"

/// What goes wrong with an HTTP server that nobody thought about, one test each.
namespace kiln::test {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr const char* kGet = "GET /v1/jobs HTTP/1.1\r\nHost: x\r\n\r\n";

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

std::vector<int> open_descriptors() {
  std::vector<int> all;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd"))
    all.push_back(std::stoi(entry.path().filename().string()));
  return all;
}

// The descriptor of this process that listens on the port; -1: none.
int listener_of(std::uint16_t port) {
  for (const int fd : open_descriptors()) {
    int listening = 0;
    socklen_t size = sizeof listening;
    if (::getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listening, &size) != 0 || !listening) continue;
    sockaddr_in address{};
    size = sizeof address;
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    if (ntohs(address.sin_port) == port) return fd;
  }
  return -1;
}

// With a backlog of five, all but a few of these wait for seconds for their SYN to be sent again.
TEST(Pitfalls, ABurstOfConnectionsFindsRoom) {
  const TempFolder folder;
  Program program(folder.path() / "data");
  program.signal(SIGSTOP);  // nobody accepts for now
  const auto address = loopback(program.port());
  std::vector<proto::Fd> burst;
  for (int i = 0; i < 500; ++i) {
    burst.emplace_back(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    ::connect(burst.back().get(), reinterpret_cast<const sockaddr*>(&address), sizeof address);
  }
  const auto deadline = Clock::now() + milliseconds(800);  // a SYN is sent again after a second
  std::size_t connected = 0;
  for (const auto& fd : burst) {
    const auto left = std::chrono::duration_cast<milliseconds>(deadline - Clock::now()).count();
    pollfd p{fd.get(), POLLOUT, 0};
    if (::poll(&p, 1, static_cast<int>(std::max<std::int64_t>(left, 0))) != 1) continue;
    connected += ::send(fd.get(), kGet, std::strlen(kGet), MSG_NOSIGNAL) > 0;
  }
  program.signal(SIGCONT);
  ASSERT_EQ(connected, burst.size());
  std::size_t answered = 0;
  for (const auto& fd : burst) {
    pollfd p{fd.get(), POLLIN, 0};
    std::array<char, 12> start{};
    answered += ::poll(&p, 1, 5000) == 1 && ::recv(fd.get(), start.data(), start.size(), 0) == 12 &&
                std::string_view(start.data(), 12) == "HTTP/1.1 200";
  }
  EXPECT_EQ(answered, burst.size());
}

// Head and body are two sends: with Nagle's algorithm the second waits 40 ms for the first's ACK.
TEST(Pitfalls, AnAnswerOnAKeptConnectionDoesNotWaitForAnAcknowledgement) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const Wire wire(live.port());
  std::vector<Clock::duration> times;
  for (int i = 0; i < 21; ++i) {
    const auto began = Clock::now();
    wire.send(kGet);
    ASSERT_NE(wire.read("next_cursor\":null}\n").find("HTTP/1.1 200"), std::string::npos);
    times.push_back(Clock::now() - began);
  }
  std::nth_element(times.begin(), times.begin() + 10, times.end());
  EXPECT_LT(times[10], milliseconds(20));
}

TEST(Pitfalls, APortBelongsToOneServer) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const proto::Fd thief(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const int yes = 1;
  ::setsockopt(thief.get(), SOL_SOCKET, SO_REUSEPORT, &yes, sizeof yes);
  const auto address = loopback(live.port());
  EXPECT_NE(::bind(thief.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const TempFolder folder;
  base::ServerConfig config;
  config.data = folder.path();
  config.port = live.port();
  config.admin_port = 0;
  const auto second = server::Service::start(
      config,
      {fake.instant(), [](const auto&, const auto&) { return proto::Expected<void>(); }, {}});
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, "cannot_listen");
}

// Part heads that a backtracking regular expression takes 0.4 s each for, or its stack's end.
TEST(Pitfalls, LongPartHeadsTakeNoTime) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  std::string body;
  for (int i = 0; i < 200; ++i)
    body += "--B\r\nContent-Disposition: form-data; name=\"f" + std::to_string(i) +
            "\"; filename=\"" + std::to_string(i) + std::string(900, 'x') + "\"; " +
            std::string(6'500, 'a') + "=\"b\"\r\n\r\nx\r\n";
  const auto began = Clock::now();
  const Answer answer = ask(live.port(), "POST", "/v1/scenes", {kForm}, body + "--B--\r\n");
  EXPECT_EQ(answer.status, 422) << answer.body;  // no `scene` among them
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(5));
  std::string longer = "--B\r\nContent-Disposition: form-data; name=\"" + std::string(9'000, 'x');
  EXPECT_EQ(
      ask(live.port(), "POST", "/v1/scenes", {kForm}, longer + "\"\r\n\r\nx\r\n--B--\r\n").status,
      400);
  std::string many;
  for (int i = 0; i < 300; ++i)
    many += "--B\r\nContent-Disposition: form-data; name=\"f\"; filename=\"" + std::to_string(i) +
            "\"\r\n\r\nx\r\n";
  EXPECT_EQ(ask(live.port(), "POST", "/v1/scenes", {kForm}, many + "--B--\r\n").status, 400);
}

TEST(Pitfalls, NobodyTellsTheLogWhoTheyAre) {
  const TempFolder folder;
  Program program(folder.path() / "data");
  const Answer answer =
      ask(program.port(), "GET", "/v1/jobs?limit=7",
          {"REMOTE_ADDR: 6.6.6.6", "X-Forwarded-For: 6.6.6.6", "X-Request-Id: req_mine"});
  ASSERT_EQ(answer.status, 200);
  ASSERT_TRUE(program.logged(answer.headers.at("x-request-id")));
  EXPECT_NE(program.log().find("\"remote\":\"127.0.0.1\""), std::string::npos);
  EXPECT_EQ(program.log().find("6.6.6.6"), std::string::npos);
  EXPECT_EQ(program.log().find("req_mine"), std::string::npos);
}

// A server whose accept() failed once must not be one that runs and can't be reached.
TEST(Pitfalls, AListenerThatFailsIsBoundAgain) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  for (int i = 0; i < 2; ++i) {
    const int listener = listener_of(live.port());
    ASSERT_GE(listener, 0);
    ASSERT_EQ(::shutdown(listener, SHUT_RDWR), 0);
    const auto deadline = Clock::now() + std::chrono::seconds(5);
    bool back = false;
    while (!back && Clock::now() < deadline) {
      const Wire wire(live.port());
      back =
          wire.connected() && wire.send(kGet) && wire.read("\r\n\r\n").starts_with("HTTP/1.1 200");
    }
    EXPECT_TRUE(back);
  }
}

// What a child process inherits stays open when we close it.
TEST(Pitfalls, NoChildInheritsADescriptor) {
  jobs::FakeBake fake;
  const std::vector<int> before = open_descriptors();
  const Live live(fake.holding());
  const std::string id = post_job(live.port());
  ASSERT_EQ(wait_for_state(live.port(), id, "running"), "running");
  EventStream stream(live.port(), id);
  ASSERT_TRUE(stream.wait_first());
  const Wire idle(live.port()), upload(live.port());
  upload.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\nglTF");
  std::this_thread::sleep_for(milliseconds(200));
  int ours = 0;
  for (const int fd : open_descriptors()) {
    if (std::find(before.begin(), before.end(), fd) != before.end()) continue;
    const int flags = ::fcntl(fd, F_GETFD);
    if (flags < 0) continue;  // the folder's own, while it was read
    ++ours;
    std::error_code error;
    EXPECT_TRUE(flags & FD_CLOEXEC)
        << std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(fd), error);
  }
  EXPECT_GE(ours, 12);
  fake.go = true;
}

TEST(Pitfalls, AStopDoesNotWaitForAPeerThatIsStuck) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const Wire stuck(live.port()), silent(live.port());
  stuck.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Length: 100000\r\n\r\nglTF");
  std::this_thread::sleep_for(milliseconds(200));
  const auto began = Clock::now();
  live.service->stop(milliseconds(300));
  EXPECT_GE(Clock::now() - began, milliseconds(300)) << "the upload was given its time";
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(2));
  EXPECT_TRUE(stuck.closed(std::chrono::seconds(1)));
  EXPECT_TRUE(silent.closed(std::chrono::seconds(1)));
}

/// A check that holds every thread that comes until it is let go.
struct Gatekeeper {
  std::atomic<bool> go{false};
  std::atomic<int> held{0};
  api::CheckFunction check() {
    return [this](const files::SceneFiles&, const proto::BakeSettings&) {
      ++held;
      while (!go) std::this_thread::sleep_for(milliseconds(5));
      return proto::Expected<void>();
    };
  }
};

TEST(Pitfalls, OverloadIsToldInsteadOfLeftToTimeOut) {
  jobs::FakeBake fake;
  Gatekeeper keeper;
  base::ServerConfig config;
  config.http_threads = 2;
  http::EdgeLimits limits;
  limits.waiting = 4;
  const Live live(fake.instant(), config, limits, keeper.check());
  const std::string post =
      "POST /v1/scenes HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: 4\r\n\r\n";
  std::vector<Wire> busy;
  for (const char* content : {"glT1", "glT2"}) {
    busy.emplace_back(live.port());
    busy.back().send(post + content);
  }
  const auto deadline = Clock::now() + std::chrono::seconds(5);
  while (keeper.held < 2 && Clock::now() < deadline) std::this_thread::yield();
  ASSERT_EQ(keeper.held, 2);
  std::vector<Wire> waiting;
  for (int i = 0; i < 4; ++i) {
    waiting.emplace_back(live.port());
    waiting.back().send(kGet);
  }
  std::this_thread::sleep_for(milliseconds(200));
  const Answer shed = ask(live.port(), "GET", "/v1/jobs");
  EXPECT_EQ(shed.status, 503);
  EXPECT_EQ(member(shed.body, "code"), "overloaded");
  EXPECT_TRUE(shed.headers.contains("retry-after"));
  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/healthz").status, 200);
  keeper.go = true;
  for (const Wire& wire : busy) EXPECT_TRUE(wire.read().starts_with("HTTP/1.1 201"));
  for (const Wire& wire : waiting) EXPECT_TRUE(wire.read("\r\n\r\n").starts_with("HTTP/1.1 200"));
}

TEST(Pitfalls, OneAddressLeavesPlacesForOthers) {
  jobs::FakeBake fake;
  http::EdgeLimits limits;
  limits.connections = 5;
  limits.connections_per_peer = 3;
  limits.linger = milliseconds(100);
  const Live live(fake.holding(), {}, limits);
  const std::string id = post_job(live.port());
  auto stream = std::make_unique<EventStream>(live.port(), id);  // a stream takes a place as well
  ASSERT_TRUE(stream->wait_first());
  std::vector<Wire> idle;
  for (int i = 0; i < 2; ++i) idle.emplace_back(live.port());
  const Wire fourth(live.port());
  const std::string text = fourth.read();
  EXPECT_TRUE(text.starts_with("HTTP/1.1 503")) << text;
  EXPECT_NE(text.find("\"too_many_connections\""), std::string::npos) << text;
  EXPECT_NE(text.find("Retry-After: "), std::string::npos);
  const Wire other(live.port(), "127.0.0.2");
  other.send(kGet);
  EXPECT_TRUE(other.read("\r\n\r\n").starts_with("HTTP/1.1 200"));
  stream.reset();
  const auto deadline = Clock::now() + std::chrono::seconds(5);
  while (ask(live.port(), "GET", "/v1/jobs").status != 200 && Clock::now() < deadline) {
  }
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200);
  fake.go = true;
}

}  // namespace
}  // namespace kiln::test
