#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "proto/expected.h"
#include "proto/files.h"
#include "server/http/loop.h"

namespace kiln::http {

/// Accepts the connections of one address and hands each on, on the loop's thread. Sockets are
/// close-on-exec from their first moment, non-blocking, and send without Nagle's delay.
class Listener final : private Loop::Watcher {
 public:
  using Take = std::function<void(proto::Fd)>;

  /// Starts to listen. `name` is for the log. Port 0 stands for any free one. Errors:
  /// `cannot_listen`.
  static proto::Expected<std::unique_ptr<Listener>> open(Loop&, std::string name,
                                                         std::string address, std::uint16_t port,
                                                         Take take);
  ~Listener() override;  ///< close()
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  std::uint16_t port() const { return port_; }
  void close();  ///< Refuses new connections from now on.

 private:
  Listener(Loop& loop, std::string name, std::string address, Take take);
  bool bind(std::uint16_t port);
  void on_failure(int error);
  void suspend(std::chrono::milliseconds);
  void resume();
  void on_events(Loop::Id, std::uint32_t events) override;
  Loop::Clock::time_point next_time() const override { return again_; }
  void on_time(Loop::Clock::time_point now) override;
  void drop(Loop::Id) noexcept override {}
  void on_detach() noexcept override;

  Loop& loop_;
  const std::string name_, address_;
  std::uint16_t port_ = 0;
  Take take_;
  proto::Fd socket_;
  bool watched_ = false;  ///< the socket is in the loop, as `id_`
  Loop::Id id_ = 0;
  /// The time to accept again after a shortage, or to bind again when the socket is gone.
  Loop::Clock::time_point again_ = Loop::Clock::time_point::max();
};

}  // namespace kiln::http
