#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "proto/files.h"
#include "server/base/event_ring.h"
#include "server/http/loop.h"

namespace kiln::http {

/// Holds all open event streams. The head of a stream's answer asks for chunked coding; the chunks
/// are written here. A client that reads slowly lags behind in its job's ring, which costs no
/// memory. It is dropped when the ring has left it behind or when it takes nothing for a minute,
/// and resumes by event id. Thread-safe.
class EventStreams final : private Loop::Watcher {
 public:
  static constexpr std::size_t kFeed = std::size_t{32} * 1024;  ///< bytes kept ready for one client
  static constexpr std::chrono::seconds kStall{60};

  /// `stall` is how long a client may take nothing of what waits for it.
  explicit EventStreams(Loop&, std::chrono::milliseconds heartbeat = std::chrono::seconds(15),
                        std::chrono::milliseconds stall = kStall);
  ~EventStreams() override;  ///< stop()
  EventStreams(const EventStreams&) = delete;
  EventStreams& operator=(const EventStreams&) = delete;

  struct Stream {
    proto::Fd socket;
    std::shared_ptr<const base::EventRing> ring;
    std::uint64_t after = 0;              ///< id of the last event that `intro` or the client has
    std::string intro;                    ///< text to send first
    std::shared_ptr<const void> place{};  ///< kept as long as the stream is open
    std::string head{};                   ///< unsent rest of the answer's head
  };
  void adopt(Stream);
  /// Notes that the ring has a new event. This is cheap.
  void notify(const base::EventRing*);
  /// Tells every present and future client that the server is going; streams go on.
  void announce_draining();
  /// Ends every stream.
  void stop();

  std::size_t streams() const { return streams_; }
  std::uint64_t dropped() const { return dropped_; }

 private:
  struct Client {
    proto::Fd socket;
    std::shared_ptr<const void> place;
    std::shared_ptr<const base::EventRing> ring;
    std::uint64_t sent = 0;
    std::string out;
    std::size_t at = 0;
    bool ended = false;                ///< the last chunk is in `out`
    bool waiting = false;              ///< waits for room in the socket
    bool pending = false;              ///< is in `pending_`
    Loop::Clock::time_point progress;  ///< time at which the socket last took bytes
  };
  void welcome(Stream&);
  void take_news();
  void follow(Loop::Id, Client&);  ///< has it served in one of the next turns
  bool feed(Client&);              ///< false: the client is lost
  void serve(Loop::Id);
  void flush(Loop::Id);
  void beat(Loop::Clock::time_point now);
  void say_all(const std::string& text);
  void on_events(Loop::Id, std::uint32_t events) override;
  Loop::Clock::time_point next_time() const override;
  void on_time(Loop::Clock::time_point now) override;
  void drop(Loop::Id) noexcept override;
  void on_detach() noexcept override;

  Loop& loop_;
  const std::chrono::milliseconds heartbeat_, stall_;
  // Only the loop's thread uses these.
  std::map<Loop::Id, Client> clients_;
  std::map<const base::EventRing*, std::set<Loop::Id>> followers_;
  /// The clients that have something to be sent. Thousands may wait for one event: they are served
  /// some at a time, so that other connections don't wait for all of them.
  std::deque<Loop::Id> pending_;
  Loop::Clock::time_point next_beat_;
  bool draining_ = false, stopped_ = false;

  std::mutex mutex_;
  std::set<const base::EventRing*> news_;  ///< guarded by mutex_
  std::atomic<std::size_t> streams_{0};
  std::atomic<std::uint64_t> dropped_{0};
};

/// Returns an event as text/event-stream.
std::string sse_text(const proto::Event&);

}  // namespace kiln::http
