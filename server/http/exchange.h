#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

#include "server/http/body.h"
#include "server/http/connection.h"
#include "server/http/head.h"
#include "server/http/lobby.h"
#include "server/http/message.h"

namespace kiln::http {

/// One request and its answer on a connection. Used by one thread at a time.
struct Exchange {
  Exchange(Connection&, RequestHead, std::string id);
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  /// Makes the response: what `handler` returns, or the problem that stands for what it throws.
  /// When that comes later, `bell` is one of the lobby's, which rings then.
  void ask(const Handler&, const Lobby&);
  /// The bell rang, the time is up, or the peer has gone: what passes from now on is not what the
  /// client asked to wait for.
  void wake() { request.asleep += Connection::Clock::now() - parked_at; }
  /// After that: makes the response that was to come later.
  void ask_again(const Lobby&);

  Connection::Clock::duration time() const { return Connection::Clock::now() - began; }
  /// Of that, what the service itself took.
  Connection::Clock::duration own_time() const;

  Connection& connection;
  const RequestHead head;
  BodyReader body;
  Request request;
  Response response;
  const Connection::Clock::time_point began = Connection::Clock::now();
  bool close = false;      ///< the connection, after the answer
  bool streaming = false;  ///< the answer's head is out, and its event stream follows
  std::shared_ptr<Lobby::Bell> bell;
  Connection::Clock::time_point parked_at{};
  std::shared_ptr<const void> parked;  ///< counts it as long as it is parked

 private:
  ssize_t read_body(char* out, std::size_t n);

  bool continued_ = false;
  std::shared_ptr<const void> watch_;  ///< what Later::watch returned
};

}  // namespace kiln::http
