#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "proto/files.h"
#include "server/base/event_ring.h"

namespace kiln::http {

/// All open event streams, on one epoll thread. A stream's response head is out already and asked
/// for chunked coding; the hub writes the chunks. A client that reads slowly lags
/// behind in its job's ring, which costs no memory; it is dropped when the ring has left it behind
/// or when it takes nothing for a minute, and resumes by event id.
class Hub {
 public:
  static constexpr std::size_t kFeed = std::size_t{32} * 1024;  ///< bytes kept ready for one client
  static constexpr std::chrono::seconds kStall{60};

  /// `stall`: how long a client may take nothing of what waits for it.
  explicit Hub(std::chrono::milliseconds heartbeat = std::chrono::seconds(15),
               std::chrono::milliseconds stall = kStall);
  ~Hub();
  Hub(const Hub&) = delete;
  Hub& operator=(const Hub&) = delete;

  struct Stream {
    proto::Fd socket;
    std::shared_ptr<const base::EventRing> ring;
    std::uint64_t after = 0;              ///< id of the last event that `intro` or the client has
    std::string intro;                    ///< text to send first
    std::shared_ptr<const void> place{};  ///< kept as long as the stream is open
  };
  void adopt(Stream);
  /// The ring has a new event. Cheap; any thread.
  void notify(const base::EventRing*);
  /// Tells every client, present and to come, that the server is going; streams go on.
  void announce_draining();
  /// Ends every stream and joins.
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
    bool ended = false;                              ///< the last chunk is in `out`
    bool waiting = false;                            ///< for room in the socket
    std::chrono::steady_clock::time_point progress;  ///< when the socket last took bytes
  };
  void loop();
  void wake() const;
  void take_requests();
  void welcome(Stream);
  void on_socket(int fd, std::uint32_t events);
  bool feed(Client&);  ///< false: the client is lost
  void serve(int fd);
  void beat();
  void say_all(const std::string& text);
  void flush(int fd);
  void drop(int fd);
  void end_all();

  std::chrono::milliseconds heartbeat_, stall_;
  proto::Fd epoll_, wake_;
  std::map<int, Client> clients_;                              ///< the hub's thread only
  std::map<const base::EventRing*, std::set<int>> followers_;  ///< the hub's thread only
  bool draining_ = false;                                      ///< the hub's thread only
  std::mutex mutex_;
  std::vector<Stream> arrivals_;           ///< guarded by mutex_
  std::set<const base::EventRing*> news_;  ///< guarded by mutex_
  bool announce_ = false;                  ///< guarded by mutex_
  std::atomic<bool> stopping_{false};
  std::atomic<std::size_t> streams_{0};
  std::atomic<std::uint64_t> dropped_{0};
  std::thread thread_;
};

/// An event as text/event-stream.
std::string sse_text(const proto::Event&);

}  // namespace kiln::http
