#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "proto/expected.h"
#include "proto/files.h"

namespace kiln::http {

/// Listens on an address and hands each connection on, from a thread of its own. Sockets are
/// close-on-exec from their first moment, non-blocking, and send without Nagle's delay.
class Acceptor {
 public:
  using Take = std::function<void(proto::Fd)>;

  /// `name` is for the log; port 0: any free one. Errors: `cannot_listen`.
  static proto::Expected<std::unique_ptr<Acceptor>> start(std::string name, std::string address,
                                                          std::uint16_t port, Take take);
  ~Acceptor();  ///< stop()
  Acceptor(const Acceptor&) = delete;
  Acceptor& operator=(const Acceptor&) = delete;

  std::uint16_t port() const { return port_; }
  void stop();  ///< refuses new connections, and joins

 private:
  Acceptor(std::string name, std::string address, Take take);
  bool bind(std::uint16_t port);
  void loop();
  bool accept_one();  ///< false: accepting has failed for good
  void pause(int milliseconds) const;

  std::string name_, address_;
  std::uint16_t port_ = 0;
  Take take_;
  proto::Fd listener_, wake_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace kiln::http
