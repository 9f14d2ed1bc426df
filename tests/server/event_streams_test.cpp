#include "server/http/event_streams.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>

namespace kiln::http {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

/// The client's end of a stream that is served.
struct Listener {
  proto::Fd near, far;

  explicit Listener(int send_buffer = 0) {
    std::array<int, 2> ends{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()), 0);
    near = proto::Fd(ends[0]);
    far = proto::Fd(ends[1]);
    if (send_buffer > 0)
      ::setsockopt(near.get(), SOL_SOCKET, SO_SNDBUF, &send_buffer, sizeof send_buffer);
  }
  /// What comes until `text` has, the stream ends, or five seconds are over.
  std::string read_until(const std::string& text) const {
    std::string all;
    const auto deadline = Clock::now() + std::chrono::seconds(5);
    while (all.find(text) == std::string::npos && Clock::now() < deadline) {
      pollfd p{far.get(), POLLIN, 0};
      if (::poll(&p, 1, 100) <= 0) continue;
      std::array<char, 4096> piece;
      const ssize_t got = ::recv(far.get(), piece.data(), piece.size(), 0);
      if (got <= 0) break;
      all.append(piece.data(), static_cast<std::size_t>(got));
    }
    return all;
  }
};

template <class Condition>
bool comes_true(const Condition& condition) {
  const auto deadline = Clock::now() + std::chrono::seconds(5);
  while (!condition() && Clock::now() < deadline) std::this_thread::yield();
  return condition();
}

proto::Event event(std::uint64_t id, std::size_t size = 10) {
  return {id, "log", std::string(size, 'x')};
}

TEST(EventStreams, ASilentStreamHearsTheHeartbeat) {
  Loop loop;
  EventStreams streams(loop, milliseconds(30));
  const auto ring = std::make_shared<base::EventRing>();
  Listener listener;
  streams.adopt({std::move(listener.near), ring, 0, "retry: 1\n\n"});
  const std::string text = listener.read_until("\n:");
  EXPECT_NE(text.find("retry: 1"), std::string::npos);
  EXPECT_NE(text.find("\n:"), std::string::npos) << "a comment line: " << text;
}

TEST(EventStreams, AClientThatTakesNothingIsDroppedAtTheDeadline) {
  Loop loop;
  EventStreams streams(loop, milliseconds(30), milliseconds(300));
  const auto ring = std::make_shared<base::EventRing>();
  Listener stuck(4096), well;
  const auto began = Clock::now();
  streams.adopt({std::move(stuck.near), ring, 0, ""});
  streams.adopt({std::move(well.near), ring, 0, ""});
  for (std::uint64_t id = 1; id <= 8; ++id) ring->push(event(id, 50'000));
  streams.notify(ring.get());
  EXPECT_NE(well.read_until("id: 8\n").find("id: 8\n"), std::string::npos);
  EXPECT_TRUE(comes_true([&] { return streams.streams() == 1; }));
  EXPECT_GE(Clock::now() - began, milliseconds(300));
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(2));
  EXPECT_EQ(streams.dropped(), 1u);
}

TEST(EventStreams, AClientThatTheRingHasLeftBehindIsDropped) {
  Loop loop;
  EventStreams streams(loop);
  const auto ring = std::make_shared<base::EventRing>();
  Listener slow(4096);
  streams.adopt({std::move(slow.near), ring, 0, ""});
  for (std::uint64_t id = 1; id <= 8; ++id) ring->push(event(id, 50'000));
  streams.notify(ring.get());
  EXPECT_TRUE(slow.read_until("id: 1\n").find("id: 1\n") != std::string::npos);
  for (std::uint64_t id = 9; id <= 9 + base::EventRing::kCapacity; ++id) ring->push(event(id));
  // It reads on, gets what was ready for it, and then the end: never a hole.
  const std::string rest = slow.read_until("no such text");
  EXPECT_EQ(rest.find("id: 1000\n"), std::string::npos);
  EXPECT_EQ(rest.find("\r\n0\r\n\r\n"), std::string::npos)
      << "a proper end would mean completeness";
  EXPECT_EQ(streams.dropped(), 1u);
  EXPECT_TRUE(comes_true([&] { return streams.streams() == 0; }));
}

TEST(EventStreams, AnAnnouncementReachesStreamsBeforeAndAfter) {
  Loop loop;
  EventStreams streams(loop);
  const auto ring = std::make_shared<base::EventRing>();
  Listener before, after;
  streams.adopt({std::move(before.near), ring, 0, ""});
  streams.announce_draining();
  EXPECT_NE(before.read_until("draining").find("server.draining"), std::string::npos);
  streams.adopt({std::move(after.near), ring, 0, ""});
  EXPECT_NE(after.read_until("draining").find("server.draining"), std::string::npos);
  streams.stop();
  EXPECT_NE(before.read_until("0\r\n\r\n").find("0\r\n\r\n"), std::string::npos);
}

}  // namespace
}  // namespace kiln::http
