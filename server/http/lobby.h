#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "server/http/connection.h"

namespace kiln::http {

/// Where connections wait: for the head of their next request, for what their present one has to
/// wait for, or for the peer to take its last answer. One epoll thread for all of them, so none
/// holds a request thread.
class Lobby {
 public:
  using Ready = std::function<void(std::unique_ptr<Connection>)>;
  /// Why a connection that was parked goes on.
  enum class End { kRung, kLate, kGone };
  using Resume = std::function<void(std::unique_ptr<Connection>, End)>;
  class Bell;
  /// Makes the answer for a head that is over the limit or past its deadline, by code.
  using LastWords = std::function<std::string(const char* code)>;

  /// `ready` is called from the lobby's thread with each connection whose head is whole.
  Lobby(const EdgeLimits&, Ready ready, LastWords last_words);
  ~Lobby();
  Lobby(const Lobby&) = delete;
  Lobby& operator=(const Lobby&) = delete;

  void adopt(std::unique_ptr<Connection>, bool fresh);  ///< waits for a head
  void linger(std::unique_ptr<Connection>);             ///< waits for the peer to close
  /// For one connection, before it is parked.
  std::shared_ptr<Bell> bell(const Connection&) const;
  /// Waits until the bell rings, which it may have done already, until the connection's deadline,
  /// or until the peer closes. `resume` is called once, from the lobby's thread; not after stop().
  /// What the peer sends meanwhile stays where it is.
  void park(std::unique_ptr<Connection>, std::shared_ptr<Bell>, Resume);
  /// Rings for all that are parked, or will be.
  void ring_all();
  /// Closes every connection; none becomes ready any more.
  void stop();

 private:
  enum class Mode { kIdle, kHead, kParked, kLinger };
  struct Guest {
    std::unique_ptr<Connection> connection;
    Mode mode = Mode::kIdle;
    std::shared_ptr<Bell> bell{};  ///< when it is parked; so `resume`
    Resume resume{};
  };
  /// What other threads leave for the lobby's. Bells have it too, which may outlive the lobby.
  struct Mail {
    proto::Fd wake;
    std::mutex mutex;
    std::vector<Guest> arrivals;              ///< guarded by mutex
    std::vector<std::shared_ptr<Bell>> rung;  ///< guarded by mutex
    bool all_rung = false;                    ///< guarded by mutex; for good
    bool closed = false;                      ///< guarded by mutex; for good
    void ring() const;                        ///< wakes the lobby's thread
  };
  void loop();
  /// Runs one step. Where memory is short it costs the connection that needed it, not the service:
  /// false then.
  template <class Step>
  static bool attempt(const Step&);
  void enter(Guest);
  void admit(Guest);
  void look_at(int fd);
  void on_socket(int fd);
  void resume(int fd, End);
  void begin_linger(Guest, const char* code);
  void expire();
  void take_mail();
  void drop(int fd);

  const EdgeLimits& limits_;
  Ready ready_;
  LastWords last_words_;
  proto::Fd epoll_;
  const std::shared_ptr<Mail> mail_ = std::make_shared<Mail>();
  std::map<int, Guest> guests_;  ///< the lobby's thread only
  std::size_t lingering_ = 0;    ///< guests that only leave: they have given their place back
  bool all_rung_ = false;        ///< the lobby's thread only
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

/// Rings for one parked connection. Thread-safe.
class Lobby::Bell {
 public:
  Bell(std::shared_ptr<Mail> mail, int fd) : mail_(std::move(mail)), fd_(fd) {}
  static void ring(const std::shared_ptr<Bell>&) noexcept;

 private:
  friend class Lobby;
  const std::shared_ptr<Mail> mail_;
  const int fd_;
  std::atomic<bool> rung_{false};
};

}  // namespace kiln::http
