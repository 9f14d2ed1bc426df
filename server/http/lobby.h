#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "server/http/connection.h"

namespace kiln::server {

/// Where connections wait: for the head of their next request, or for the peer to take its last
/// answer. One epoll thread for all of them, so a slow or idle peer holds no request thread.
class Lobby {
 public:
  using Ready = std::function<void(std::unique_ptr<Connection>)>;
  /// Makes the answer for a head that is over the limit or past its deadline, by code.
  using LastWords = std::function<std::string(const char* code)>;

  /// `ready` is called from the lobby's thread with each connection whose head is whole.
  Lobby(const EdgeLimits&, Ready ready, LastWords last_words);
  ~Lobby();
  Lobby(const Lobby&) = delete;
  Lobby& operator=(const Lobby&) = delete;

  void adopt(std::unique_ptr<Connection>, bool fresh);  ///< waits for a head
  void linger(std::unique_ptr<Connection>);             ///< waits for the peer to close
  /// Closes every connection; none becomes ready any more.
  void stop();

 private:
  enum class Mode { kIdle, kHead, kLinger };
  struct Guest {
    std::unique_ptr<Connection> connection;
    Mode mode = Mode::kIdle;
  };
  void loop();
  /// Runs one step. Where memory is short it costs the connection that needed it, not the service:
  /// false then.
  template <class Step>
  static bool attempt(const Step&);
  void wake() const;
  void enter(std::unique_ptr<Connection>, Mode);
  void admit(Guest);
  void look_at(int fd);
  void begin_linger(Guest, const char* code);
  void expire();
  void take_arrivals();
  void drop(int fd);

  const EdgeLimits& limits_;
  Ready ready_;
  LastWords last_words_;
  proto::Fd epoll_, wake_;
  std::map<int, Guest> guests_;  ///< the lobby's thread only
  std::size_t lingering_ = 0;    ///< guests that only leave: they have given their place back
  std::mutex mutex_;
  std::vector<Guest> arrivals_;  ///< guarded by mutex_
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace kiln::server
