#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "server/http/answer.h"
#include "server/http/body.h"
#include "server/http/connection.h"
#include "server/http/head.h"
#include "server/http/message.h"
#include "server/http/waiting_connections.h"

namespace kiln::http {

/// One request and its answer on a connection. Used by one thread at a time.
class Exchange {
 public:
  using Clock = Connection::Clock;

  Exchange(std::shared_ptr<Connection>, RequestHead, std::string id);
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  /// Makes the response: what `handler` returns, or the problem that stands for what it throws.
  /// When the response comes later, `waker` continues it.
  void ask(const Handler& handler, const WaitingConnections&);
  /// Makes the response that waited for something.
  void ask_again(const WaitingConnections&);
  /// Makes the response that waited for the body, which is whole or has failed.
  void ask_with_body(const WaitingConnections&);

  /// Returns whether the whole body has arrived already, with the head.
  bool has_whole_body() const;
  /// Begins to receive the body that the response asks for. Returns false when its announced size
  /// is over the limit, after a call of `fail_body`.
  bool begin_body();
  enum class Moved { kAll, kBlocked, kMore };
  /// Receives what has arrived, up to about `most` bytes. Returns kMore when there may be more, and
  /// kAll when the body is whole or has failed.
  Moved receive(std::size_t most);
  void fail_body(proto::Error error) { received_ = proto::Unexpected(std::move(error)); }
  void fail_slow_body();

  /// Decides what follows the answer, and begins it. `last`: no request may follow.
  void begin_answer(bool last);
  /// Sends what the peer takes, as receive() does. Returns kAll also when it takes nothing any
  /// more.
  Moved send(std::uint64_t most);
  void give_up_answer() { broken_ = true; }
  std::uint64_t bytes_written() const { return connection->bytes_written() - written_before_; }
  /// Returns whether another request may follow on the connection, after the answer.
  bool keeps_connection() const { return !close_ && !broken_; }
  std::string head_of_stream() const { return answer_.rest_of_head(); }

  /// The connection waits for its client from here to end_wait(), in a transfer.
  void begin_wait() { waits_since_ = Clock::now(); }
  void end_wait() { waited_ += Clock::now() - waits_since_; }
  Clock::duration time() const { return Clock::now() - began_; }
  /// Returns the part of that time that the service itself took.
  Clock::duration own_time() const { return time() - waited_ - request.asleep; }

  const std::shared_ptr<Connection> connection;
  const RequestHead head;
  Request request;
  Response response;
  TransferClock clock;           ///< measures the body, then the answer
  std::shared_ptr<Waker> waker;  ///< continues a deferred response
  bool was_parked = false;
  std::shared_ptr<const void> active;  ///< counts it while a thread or a transfer is at it
  std::shared_ptr<const void> parked;  ///< counts it while it is parked
  ConcurrencyLimiter::Permit of_peer, of_tenant;  ///< held while its body arrives

 private:
  void guard(const std::function<void()>& step);
  proto::Expected<void> take(std::string_view bytes);
  Moved end_body(proto::Expected<void> received);

  const Clock::time_point began_ = Clock::now();
  Clock::time_point waits_since_{};
  Clock::duration waited_{};
  BodyDecoder body_;
  DigestCheck digest_;
  std::uint64_t body_bytes_ = 0;
  proto::Expected<void> received_;
  Answer answer_;
  bool close_ = false, broken_ = false;
  std::uint64_t written_before_;
  std::shared_ptr<const void> watch_;  ///< what Deferred::watch returned
};

}  // namespace kiln::http
