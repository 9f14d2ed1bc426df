#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "proto/expected.h"
#include "server/http/connection.h"
#include "server/http/message.h"

namespace kiln::http {

class EventStreams;
class Loop;

struct HttpOptions {
  std::string name = "http";  ///< name in the log
  std::string listen = "127.0.0.1";
  std::uint16_t port = 0;  ///< 0: any free port
  unsigned threads = 16;
  EdgeLimits limits;
  /// Called with each request when its answer is known, and with 499 when the client of a waiting
  /// request has gone. Null: requests are not counted.
  std::function<void(const Request&, int status, std::chrono::duration<double>)> count{};
  /// A request that takes the service longer than this is logged; its client's time does not count.
  std::chrono::milliseconds slow{0};  ///< 0: none is
};

/// Serves HTTP/1.1 around a handler. Connections wait in the loop, whatever for. A request thread
/// makes answers, and a few transfer threads move the bytes of bodies that have arrived, or of
/// answers that the peer has room for. No thread waits for a client.
class HttpServer {
 public:
  /// Binds and starts to serve. Loop and streams must live longer. Errors: `cannot_listen`.
  static proto::Expected<std::unique_ptr<HttpServer>> start(HttpOptions, Handler, Loop&,
                                                            EventStreams&);
  ~HttpServer();  ///< stop() without a grace, unless done

  std::uint16_t port() const;
  std::size_t connections() const;  ///< open now, event streams among them
  std::size_t waiting() const;      ///< requests whose answer comes later
  std::size_t uploads() const;      ///< requests whose body is arriving
  /// Refuses new connections, has requests that wait answered, lets running ones finish for up to
  /// `grace`, then cuts them.
  void stop(std::chrono::milliseconds grace);

 private:
  struct Impl;
  explicit HttpServer(std::unique_ptr<Impl>);
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::http
