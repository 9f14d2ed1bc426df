#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "server/http/connection.h"
#include "server/http/loop.h"

namespace kiln::http {

/// Goes on with one connection that is parked. Thread-safe; it may outlive the loop.
class Waker {
 public:
  /// Has the connection go on, now or when it is parked. Later calls do nothing.
  static void wake(const std::shared_ptr<Waker>&) noexcept;

 private:
  friend class WaitingConnections;
  explicit Waker(std::shared_ptr<Inbox> inbox) : inbox_(std::move(inbox)) {}
  const std::shared_ptr<Inbox> inbox_;
  std::atomic<bool> woken_{false};
  std::function<void()> go_on_;  ///< set while it is parked; the loop's thread only
};

/// Holds connections that wait without a thread: for the head of their next request, for bytes of
/// its body or room for those of its answer, for what a deferred answer waits for, or for the peer
/// to take its last answer. Thread-safe, except where a comment says otherwise.
class WaitingConnections final : private Loop::Watcher {
 public:
  using ConnectionPtr = std::shared_ptr<Connection>;
  /// Takes over a connection whose head is whole. Called on the loop's thread.
  using Ready = std::function<void(ConnectionPtr)>;
  /// Makes the answer for a head that is over the limit or past its deadline, by code.
  using LastWords = std::function<std::string(const char* code)>;
  /// The reason why a connection goes on.
  enum class End { kReady, kWoken, kLate, kGone };
  /// Called once, on the loop's thread, but not when the connection is closed with everything.
  using Resume = std::function<void(End)>;
  enum class For { kBytes, kRoom };

  WaitingConnections(Loop&, const EdgeLimits&, Ready, LastWords);
  ~WaitingConnections() override;  ///< close()
  WaitingConnections(const WaitingConnections&) = delete;
  WaitingConnections& operator=(const WaitingConnections&) = delete;

  /// Waits for a head. `fresh` is set for the connection's first one.
  void await_head(ConnectionPtr, bool fresh);
  /// Waits until bytes can be read, or written, or until the connection's deadline.
  void await(ConnectionPtr, For, Resume);
  /// Returns a waker for one connection that is to be parked.
  std::shared_ptr<Waker> waker() const;
  /// Waits until it is woken, which may have happened already, until the connection's deadline, or
  /// until the peer closes. What the peer sends meanwhile stays where it is.
  void park(ConnectionPtr, std::shared_ptr<Waker>, Resume);
  /// Waits for the peer to close, for a short time. Gives its place among the open ones back.
  void linger(ConnectionPtr);
  /// Wakes all that are parked, or will be.
  void wake_all();
  /// Closes every connection. Nothing is called for them afterwards.
  void close();

 private:
  enum class Mode { kIdle, kHead, kTransfer, kParked, kLinger };
  struct Entry {
    ConnectionPtr connection;
    Mode mode = Mode::kIdle;
    std::uint32_t events = 0;
    Resume resume{};                 ///< set while in transfer or parked
    std::shared_ptr<Waker> waker{};  ///< set while parked
    Loop::Clock::time_point deadline{};
  };
  void post(Entry);
  void enter(Entry);
  Entry leave(Loop::Id) noexcept;
  void resume(Loop::Id, End);
  void set_deadline(Loop::Id, Entry&, Loop::Clock::time_point);
  void read_head(Loop::Id);
  void begin_linger(ConnectionPtr, const char* code);
  void expire(Loop::Id);
  void on_events(Loop::Id, std::uint32_t events) override;
  Loop::Clock::time_point next_time() const override;
  void on_time(Loop::Clock::time_point now) override;
  void drop(Loop::Id) noexcept override;
  void on_detach() noexcept override;

  Loop& loop_;
  const EdgeLimits& limits_;
  const Ready ready_;
  const LastWords last_words_;
  // Only the loop's thread uses all of these.
  std::map<Loop::Id, Entry> entries_;
  std::set<std::pair<Loop::Clock::time_point, Loop::Id>> deadlines_;
  std::size_t lingering_ = 0;  ///< entries that only leave: they have given their place back
  bool all_woken_ = false;
  bool closed_ = false;
};

}  // namespace kiln::http
