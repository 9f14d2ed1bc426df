#include "server/http/waiting_connections.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <array>
#include <condition_variable>
#include <mutex>
#include <optional>

/// Connections that wait in the loop, most of them parked until they are woken.
namespace kiln::http {
namespace {

using std::chrono::milliseconds;
using Clock = Connection::Clock;
using End = WaitingConnections::End;

class ParkedConnection : public testing::Test {
 protected:
  struct Client {
    std::shared_ptr<Connection> connection;
    proto::Fd far;
    std::shared_ptr<Waker> waker;
  };

  Client client(milliseconds patience = std::chrono::seconds(60)) {
    std::array<int, 2> ends{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends.data()), 0);
    Client made{std::make_shared<Connection>(proto::Fd(ends[0]), limits_), proto::Fd(ends[1]), {}};
    made.connection->deadline = Clock::now() + patience;
    made.waker = waiting_.waker();
    return made;
  }
  void park(Client& client) {
    const auto connection = std::move(client.connection);
    waiting_.park(connection, client.waker, [this, connection](End end) {
      const std::lock_guard lock(mutex_);
      back_ = connection;
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
  std::shared_ptr<Connection> back_;  ///< the last that went on
  std::vector<End> ends_;
  Loop loop_;
  WaitingConnections waiting_{loop_, limits_, [](const std::shared_ptr<Connection>&) {},
                              [](const char*) { return ""; }};
};

TEST_F(ParkedConnection, GoesOnWhenItIsWokenAndOnlyOnce) {
  Client one = client(), other = client();
  park(one);
  park(other);
  EXPECT_TRUE(ends(1, milliseconds(50)).empty());
  Waker::wake(one.waker);
  Waker::wake(one.waker);
  EXPECT_EQ(ends(1), std::vector{End::kWoken});
  EXPECT_EQ(ends(2, milliseconds(50)).size(), 1u);
}

TEST_F(ParkedConnection, GoesOnWhenItWasWokenBefore) {
  Client early = client();
  Waker::wake(early.waker);
  park(early);
  EXPECT_EQ(ends(1), std::vector{End::kWoken});
}

TEST_F(ParkedConnection, IsNotWokenByTheWakerOfOneThatHadItsNumber) {
  Client first = client();
  const int number = first.connection->fd();
  first.connection.reset();
  Client second = client();
  ASSERT_EQ(second.connection->fd(), number);
  park(second);
  Waker::wake(first.waker);
  EXPECT_TRUE(ends(1, milliseconds(50)).empty());
  Waker::wake(second.waker);
  EXPECT_EQ(ends(1), std::vector{End::kWoken});
}

TEST_F(ParkedConnection, GoesOnAtItsDeadline) {
  const auto began = Clock::now();
  Client brief = client(milliseconds(300));
  park(brief);
  EXPECT_EQ(ends(1), std::vector{End::kLate});
  EXPECT_GE(Clock::now() - began, milliseconds(300));
}

TEST_F(ParkedConnection, HearsThatItsPeerHasGone) {
  Client gone = client(), half = client();
  park(gone);
  gone.far.reset();
  EXPECT_EQ(ends(1), std::vector{End::kGone});
  park(half);
  ::shutdown(half.far.get(), SHUT_WR);
  EXPECT_EQ(ends(2).back(), End::kGone);
}

// What a client sends ahead stays in the socket. A loop that looked at it would never sleep.
TEST_F(ParkedConnection, LeavesWhatItsPeerSendsAloneAndSleeps) {
  const auto processor_time = [] {
    rusage use{};
    ::getrusage(RUSAGE_SELF, &use);
    return std::chrono::seconds(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           std::chrono::microseconds(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
  };
  Client eager = client();
  park(eager);
  const std::string next = "GET / HTTP/1.1\r\nHost: x\r\n\r\n";
  ASSERT_EQ(::send(eager.far.get(), next.data(), next.size(), 0), ssize_t(next.size()));
  const auto before = processor_time();
  EXPECT_TRUE(ends(1, milliseconds(500)).empty());
  EXPECT_LT(processor_time() - before, milliseconds(150));
  Waker::wake(eager.waker);
  ends(1);
  ASSERT_TRUE(back_);
  EXPECT_EQ(back_->fill(), Connection::Fill::kHead);
  EXPECT_EQ(back_->take_head(), next);
}

TEST_F(ParkedConnection, GoesOnWhenAllAreWokenAlsoAfterwards) {
  Client one = client(), two = client(), late = client();
  park(one);
  park(two);
  waiting_.wake_all();
  EXPECT_EQ(ends(2).size(), 2u);
  park(late);
  EXPECT_EQ(ends(3), (std::vector{End::kWoken, End::kWoken, End::kWoken}));
}

TEST_F(ParkedConnection, IsClosedWithTheOthersAndItsWakerMayOutliveThem) {
  Client left = client(), after = client();
  park(left);
  waiting_.close();
  park(after);
  Waker::wake(left.waker);
  for (const Client* c : {&left, &after}) {
    char byte = 0;
    pollfd closed{c->far.get(), POLLIN, 0};  // the loop's thread closes it, in its own time
    EXPECT_EQ(::poll(&closed, 1, 10'000), 1);
    EXPECT_EQ(::recv(c->far.get(), &byte, 1, 0), 0);
  }
  EXPECT_TRUE(ends_.empty());
}

}  // namespace
}  // namespace kiln::http
