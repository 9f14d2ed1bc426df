#include "server/http/lobby.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <array>
#include <condition_variable>
#include <mutex>
#include <optional>

/// Connections that are parked until their bell rings.
namespace kiln::http {
namespace {

using std::chrono::milliseconds;
using Clock = Connection::Clock;
using End = Lobby::End;

class ParkedInLobby : public testing::Test {
 protected:
  struct Guest {
    std::unique_ptr<Connection> connection;
    proto::Fd far;
    std::shared_ptr<Lobby::Bell> bell;
  };

  Guest guest(milliseconds patience = std::chrono::seconds(60)) {
    std::array<int, 2> ends{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends.data()), 0);
    Guest made{std::make_unique<Connection>(proto::Fd(ends[0]), limits_), proto::Fd(ends[1]), {}};
    made.connection->deadline = Clock::now() + patience;
    made.bell = lobby_.bell(*made.connection);
    return made;
  }
  void park(Guest& guest) {
    lobby_.park(std::move(guest.connection), guest.bell,
                [this](std::unique_ptr<Connection> connection, End end) {
                  const std::lock_guard lock(mutex_);
                  back_ = std::move(connection);
                  ends_.push_back(end);
                  changed_.notify_all();
                });
  }
  std::vector<End> ends(std::size_t count, milliseconds time = std::chrono::seconds(10)) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, time, [&] { return ends_.size() >= count; });
    return ends_;
  }

  const EdgeLimits limits_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::unique_ptr<Connection> back_;  ///< the last that went on
  std::vector<End> ends_;
  Lobby lobby_{limits_, [](std::unique_ptr<Connection>) {}, [](const char*) { return ""; }};
};

TEST_F(ParkedInLobby, GoesOnWhenItsBellRingsAndOnlyOnce) {
  Guest one = guest(), other = guest();
  park(one);
  park(other);
  EXPECT_TRUE(ends(1, milliseconds(50)).empty());
  Lobby::Bell::ring(one.bell);
  Lobby::Bell::ring(one.bell);
  EXPECT_EQ(ends(1), std::vector{End::kRung});
  EXPECT_EQ(ends(2, milliseconds(50)).size(), 1u);
}

TEST_F(ParkedInLobby, HearsABellThatHasRungBefore) {
  Guest early = guest();
  Lobby::Bell::ring(early.bell);
  park(early);
  EXPECT_EQ(ends(1), std::vector{End::kRung});
}

TEST_F(ParkedInLobby, IsNotWokenByTheBellOfOneThatHadItsNumber) {
  Guest first = guest();
  const int number = first.connection->fd();
  first.connection.reset();
  Guest second = guest();
  ASSERT_EQ(second.connection->fd(), number);
  park(second);
  Lobby::Bell::ring(first.bell);
  EXPECT_TRUE(ends(1, milliseconds(50)).empty());
  Lobby::Bell::ring(second.bell);
  EXPECT_EQ(ends(1), std::vector{End::kRung});
}

TEST_F(ParkedInLobby, GoesOnAtItsDeadline) {
  const auto began = Clock::now();
  Guest brief = guest(milliseconds(300));
  park(brief);
  EXPECT_EQ(ends(1), std::vector{End::kLate});
  EXPECT_GE(Clock::now() - began, milliseconds(300));
}

TEST_F(ParkedInLobby, HearsThatItsPeerHasGone) {
  Guest gone = guest(), half = guest();
  park(gone);
  gone.far.reset();
  EXPECT_EQ(ends(1), std::vector{End::kGone});
  park(half);
  ::shutdown(half.far.get(), SHUT_WR);
  EXPECT_EQ(ends(2).back(), End::kGone);
}

// What a client sends ahead stays in the socket. A loop that looked at it would never sleep.
TEST_F(ParkedInLobby, LeavesWhatItsPeerSendsAloneAndSleeps) {
  const auto processor_time = [] {
    rusage use{};
    ::getrusage(RUSAGE_SELF, &use);
    return std::chrono::seconds(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           std::chrono::microseconds(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
  };
  Guest eager = guest();
  park(eager);
  const std::string next = "GET / HTTP/1.1\r\nHost: x\r\n\r\n";
  ASSERT_EQ(::send(eager.far.get(), next.data(), next.size(), 0), ssize_t(next.size()));
  const auto before = processor_time();
  EXPECT_TRUE(ends(1, milliseconds(500)).empty());
  EXPECT_LT(processor_time() - before, milliseconds(150));
  Lobby::Bell::ring(eager.bell);
  ends(1);
  ASSERT_TRUE(back_);
  EXPECT_EQ(back_->fill(), Connection::Fill::kHead);
  EXPECT_EQ(back_->take_head(), next);
}

TEST_F(ParkedInLobby, GoesOnWhenAllBellsRingAlsoAfterwards) {
  Guest one = guest(), two = guest(), late = guest();
  park(one);
  park(two);
  lobby_.ring_all();
  EXPECT_EQ(ends(2).size(), 2u);
  park(late);
  EXPECT_EQ(ends(3), (std::vector{End::kRung, End::kRung, End::kRung}));
}

TEST_F(ParkedInLobby, IsClosedWithTheLobbyWhichItsBellMayOutlive) {
  Guest left = guest(), after = guest();
  park(left);
  lobby_.stop();
  park(after);
  Lobby::Bell::ring(left.bell);
  for (const Guest* g : {&left, &after}) {
    char byte = 0;
    EXPECT_EQ(::recv(g->far.get(), &byte, 1, 0), 0);
  }
  EXPECT_TRUE(ends_.empty());
}

}  // namespace
}  // namespace kiln::http
