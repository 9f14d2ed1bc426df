#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <unordered_map>
#include <vector>

#include "proto/files.h"

namespace kiln::http {

/// Holds tasks that other threads leave for a loop. It may outlive the loop. Thread-safe.
class Inbox {
 public:
  using Task = std::function<void()>;

  Inbox();
  /// Leaves a task for the loop's thread. Returns false, and drops the task, when the loop has
  /// stopped or memory is short.
  bool post(Task) noexcept;
  bool closed();  ///< returns whether the loop has stopped for good

 private:
  friend class Loop;
  std::vector<Task> take();   ///< everything that was left
  std::vector<Task> close();  ///< the same, and refuses tasks from now on

  const proto::Fd wake_;
  std::mutex mutex_;
  std::vector<Task> tasks_;  ///< guarded by mutex_
  bool closed_ = false;      ///< guarded by mutex_
};

/// Runs one thread around epoll. Everything of the HTTP server that waits for a socket waits here:
/// the listeners, connections without a request thread, and event streams. Each is a Watcher, whose
/// functions run on this thread only and never block.
class Loop {
 public:
  using Clock = std::chrono::steady_clock;
  /// Names a watched socket. No number is used twice, other than those of descriptors.
  using Id = std::uint64_t;

  class Watcher {
   public:
    virtual ~Watcher() = default;
    /// Called when the socket has these epoll events. It throws std::bad_alloc at most; then drop()
    /// follows.
    virtual void on_events(Id, std::uint32_t events) = 0;
    /// Returns when on_time() is due; max() means never.
    virtual Clock::time_point next_time() const = 0;
    virtual void on_time(Clock::time_point now) = 0;
    /// Called when memory is short: this socket is given up, the others stay.
    virtual void drop(Id) noexcept = 0;
    /// Called when the watcher is detached, or the loop ends. The watcher closes its sockets.
    virtual void on_detach() noexcept = 0;
  };

  Loop();   ///< starts the thread
  ~Loop();  ///< stop()
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  const std::shared_ptr<Inbox>& inbox() const { return inbox_; }
  /// Watches for `watcher` from now on. It waits for the loop's thread, so it must not be called
  /// there.
  void attach(Watcher& watcher);
  /// Calls on_detach() and no other function of the watcher afterwards. It waits as well.
  void detach(Watcher& watcher);
  /// Detaches every watcher and joins.
  void stop();

  // Only the loop's thread calls these.
  Id add(int fd, std::uint32_t events, Watcher&);
  void modify(Id, int fd, std::uint32_t events);
  void remove(Id, int fd) noexcept;

 private:
  void run();
  void turn();
  void dispatch(Id, std::uint32_t events);
  void run_tasks(std::vector<Inbox::Task>);
  void call(const Inbox::Task&);  ///< on the loop's thread, and waits for it

  proto::Fd epoll_;
  const std::shared_ptr<Inbox> inbox_ = std::make_shared<Inbox>();
  std::vector<Watcher*> watchers_;            ///< the loop's thread only
  std::unordered_map<Id, Watcher*> sockets_;  ///< the loop's thread only
  Id last_id_ = 0;                            ///< the loop's thread only
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace kiln::http
