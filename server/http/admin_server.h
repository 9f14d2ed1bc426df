#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "proto/expected.h"
#include "server/http/message.h"

namespace kiln::http {

/// Returns the admin port's answer for a path. Called from several threads.
using AdminPages = std::map<std::string, std::function<Response()>>;

/// Serves the admin port: health, readiness and metrics, for the operator's own network.
/// cpp-httplib does this job whole (sockets, parsing, routing, answering) and by its public
/// interface. The API has an HTTP server of its own, since the packaged version keeps a thread for
/// every connection and bounds neither heads nor the time that they take.
///
/// Here that is bounded from outside: sockets with data only, a small receive window, no bodies,
/// one request a connection, and a deadline after which the port's connections are cut.
class AdminServer {
 public:
  /// Starts the server. Port 0 stands for any free one. Errors: `cannot_listen`.
  static proto::Expected<std::unique_ptr<AdminServer>> start(const std::string& address,
                                                             std::uint16_t port, AdminPages);
  ~AdminServer();  ///< stop()

  std::uint16_t port() const;
  /// Refuses new connections and waits for those that are being answered.
  void stop();

 private:
  struct Impl;
  explicit AdminServer(std::unique_ptr<Impl>);
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::http
