#include "server/http/http_server.h"

#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <new>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "server/base/ids.h"
#include "server/base/log.h"
#include "server/http/acceptor.h"
#include "server/http/answer_writer.h"
#include "server/http/exchange.h"
#include "server/http/hub.h"
#include "server/http/lobby.h"
#include "server/http/problem.h"
#include "server/http/worker_pool.h"

namespace kiln::http {

struct HttpServer::Impl {
  Impl(HttpOptions o, Handler h, Hub& the_hub)
      : options(std::move(o)),
        handler(std::move(h)),
        hub(the_hub),
        census(options.limits.connections, options.limits.connections_per_peer),
        pool(options.threads, options.limits.waiting),
        lobby(
            options.limits, [this](std::unique_ptr<Connection> c) { on_head(std::move(c)); },
            [](const char* code) { return refusal(code); }) {}

  HttpOptions options;
  Handler handler;
  Hub& hub;
  std::atomic<bool> stopping{false};
  std::uint16_t bound_port = 0;
  std::mutex mutex;
  std::condition_variable changed;
  std::set<int> active;    ///< sockets of running requests; guarded by mutex
  std::size_t parked = 0;  ///< requests whose answer comes later; guarded by mutex
  AnswerWriter writer;
  Census census;
  WorkerPool pool;
  Lobby lobby;
  std::unique_ptr<Acceptor> acceptor;

  /// Counts a connection among the active ones while a thread works on it.
  class Turn;
  proto::Expected<void> listen();
  void take(proto::Fd);
  void on_head(std::unique_ptr<Connection>);
  template <class Step>
  void work(std::unique_ptr<Connection>, const Step&);
  void serve(std::unique_ptr<Connection>);
  void resume(const std::shared_ptr<Exchange>&, std::unique_ptr<Connection>);
  bool begin(std::unique_ptr<Connection>&, Turn&);
  bool go_on(const std::shared_ptr<Exchange>&, std::unique_ptr<Connection>&, Turn&);
  bool answer(Exchange&, std::unique_ptr<Connection>&, Turn&);
  void park(const std::shared_ptr<Exchange>&, std::unique_ptr<Connection>, Turn&);
  void log_gone(Exchange&) const;
  void count(const Exchange&) const;
  void log_request(const Exchange&) const;
  static std::string refusal(const char* code);
};

std::string HttpServer::Impl::refusal(const char* code) {
  const std::string_view what = code;
  const std::string text = what == "request_timeout" ? "The request's head did not arrive in time."
                           : what == "overloaded"    ? "The service has too many connections."
                           : what == "too_many_connections"
                               ? "Too many connections of this address are open."
                               : "The request's head is over 32 KiB.";
  return raw_problem({code, text, {}}, base::new_id("req_"));
}

proto::Expected<void> HttpServer::Impl::listen() {
  auto made = Acceptor::start(options.name, options.listen, options.port,
                              [this](proto::Fd fd) { take(std::move(fd)); });
  if (!made) return proto::Unexpected(made.error());
  acceptor = std::move(*made);
  bound_port = acceptor->port();
  return {};
}

void HttpServer::Impl::take(proto::Fd fd) {
  auto [place, refused] = census.enter(fd.get());
  auto connection = std::make_unique<Connection>(std::move(fd), options.limits, std::move(place));
  if (refused == Census::Refusal::kNone) return lobby.adopt(std::move(connection), /*fresh=*/true);
  connection->write_at_once(
      refusal(refused == Census::Refusal::kFull ? "overloaded" : "too_many_connections"));
  lobby.linger(std::move(connection));
}

void HttpServer::Impl::on_head(std::unique_ptr<Connection> connection) {
  // std::function wants copies: the task shares the connection and moves it out.
  auto shared = std::make_shared<std::unique_ptr<Connection>>(std::move(connection));
  if (pool.enqueue([this, shared] { serve(std::move(*shared)); })) return;
  (*shared)->write_at_once(refusal("overloaded"));
  lobby.linger(std::move(*shared));
}

class HttpServer::Impl::Turn {
 public:
  Turn(Impl& impl, int fd) : impl_(impl), fd_(fd) {
    const std::lock_guard lock(impl_.mutex);
    impl_.active.insert(fd_);
  }
  ~Turn() { end(); }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;
  /// Before others may close the connection, or take it up: the number is theirs then.
  void end() {
    if (std::exchange(ended_, true)) return;
    {
      const std::lock_guard lock(impl_.mutex);
      impl_.active.erase(fd_);
    }
    impl_.changed.notify_all();
  }

 private:
  Impl& impl_;
  const int fd_;
  bool ended_ = false;
};

// A step says whether the connection is kept. It moves it out where another has it from then on:
// the hub, or the lobby until the answer can be given.
template <class Step>
void HttpServer::Impl::work(std::unique_ptr<Connection> connection, const Step& step) {
  Turn turn(*this, connection->fd());
  bool keep = false;
  try {
    keep = step(connection, turn);
  } catch (const std::bad_alloc&) {  // not even an answer could be made: the connection ends
  }
  turn.end();
  if (!connection) return;
  if (keep && !stopping)
    lobby.adopt(std::move(connection), /*fresh=*/false);
  else
    lobby.linger(std::move(connection));
}

void HttpServer::Impl::serve(std::unique_ptr<Connection> connection) {
  work(std::move(connection), [&](auto& held, Turn& turn) { return begin(held, turn); });
}

void HttpServer::Impl::resume(const std::shared_ptr<Exchange>& exchange,
                              std::unique_ptr<Connection> connection) {
  work(std::move(connection), [&](auto& held, Turn& turn) {
    exchange->parked.reset();
    const base::LogRequest context(exchange->request.id);
    exchange->ask_again(lobby);
    return go_on(exchange, held, turn);
  });
}

bool HttpServer::Impl::begin(std::unique_ptr<Connection>& connection, Turn& turn) {
  connection->begin_exchange();
  auto head = parse_head(connection->take_head());
  const std::string id = base::new_id("req_");
  const base::LogRequest context(id);
  if (!head) {
    log_line(base::LogLevel::kInfo, "request",
             {{"remote", connection->peer_address()}, {"code", head.error().code}});
    connection->write(raw_problem(head.error(), id));
    return false;
  }
  const auto exchange = std::make_shared<Exchange>(*connection, std::move(*head), id);
  exchange->ask(handler, lobby);
  return go_on(exchange, connection, turn);
}

bool HttpServer::Impl::go_on(const std::shared_ptr<Exchange>& exchange,
                             std::unique_ptr<Connection>& connection, Turn& turn) {
  // What has waited already and would wait again must not turn in a circle when all bells ring.
  const bool again = exchange->parked_at != Connection::Clock::time_point{};
  if (exchange->response.later && stopping && again)
    exchange->response = problem({"draining", "The service is going.", {}}, exchange->request);
  if (!exchange->response.later) return answer(*exchange, connection, turn);
  park(exchange, std::move(connection), turn);
  return true;
}

void HttpServer::Impl::park(const std::shared_ptr<Exchange>& exchange,
                            std::unique_ptr<Connection> connection, Turn& turn) {
  {
    const std::lock_guard lock(mutex);
    ++parked;
  }
  exchange->parked = std::shared_ptr<const void>(this, [this](const void*) {
    {
      const std::lock_guard lock(mutex);
      --parked;
    }
    changed.notify_all();
  });
  exchange->parked_at = Connection::Clock::now();
  connection->deadline = exchange->response.later->until;
  const auto go = [this, exchange](std::unique_ptr<Connection> back, Lobby::End end) {
    exchange->wake();
    auto shared = std::make_shared<std::unique_ptr<Connection>>(std::move(back));
    pool.enqueue_again([this, exchange, shared, end] {
      if (end == Lobby::End::kGone) return log_gone(*exchange);
      resume(exchange, std::move(*shared));
    });
  };
  turn.end();
  lobby.park(std::move(connection), exchange->bell, go);
}

bool HttpServer::Impl::answer(Exchange& exchange, std::unique_ptr<Connection>& connection,
                              Turn& turn) {
  count(exchange);
  // What is left of a body would be read as the next request.
  exchange.close = exchange.head.wants_close() || !exchange.body.done() || stopping;
  const AnswerWriter::End end = writer.write(exchange);
  log_request(exchange);
  if (end == AnswerWriter::End::kStream) {
    turn.end();
    StreamContent& content = *exchange.response.stream;
    hub.adopt({connection->release(), std::move(content.ring), content.after,
               std::move(content.intro), connection->release_place()});
    connection.reset();
  }
  return end == AnswerWriter::End::kKeep;
}

// As others do, it has a status that no answer ever has.
void HttpServer::Impl::log_gone(Exchange& exchange) const {
  constexpr int kClientGone = 499;
  const base::LogRequest context(exchange.request.id);
  exchange.response.status = kClientGone;
  count(exchange);
  log_request(exchange);
}

void HttpServer::Impl::count(const Exchange& exchange) const {
  if (options.count)
    options.count(exchange.request, exchange.response.status,
                  std::chrono::duration<double>(exchange.time()));
}

void HttpServer::Impl::log_request(const Exchange& exchange) const {
  const auto milliseconds = [](Connection::Clock::duration time) {
    return std::round(std::chrono::duration<double, std::micro>(time).count()) / 1000;
  };
  const auto own = exchange.own_time();
  const bool slow = options.slow.count() > 0 && own >= options.slow;
  log_line(slow ? base::LogLevel::kWarn : base::LogLevel::kInfo, slow ? "request.slow" : "request",
           {{"server", options.name},
            {"method", exchange.head.method},
            {"path", exchange.head.path},
            {"status", exchange.response.status},
            {"bytes", exchange.connection.bytes_written()},
            {"ms", milliseconds(exchange.time())},
            {"own_ms", milliseconds(own)},
            {"remote", exchange.connection.peer_address()}});
}

proto::Expected<std::unique_ptr<HttpServer>> HttpServer::start(HttpOptions options, Handler handler,
                                                               Hub& hub) {
  auto impl = std::make_unique<Impl>(std::move(options), std::move(handler), hub);
  if (auto listening = impl->listen(); !listening) return proto::Unexpected(listening.error());
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() {
  stop(std::chrono::milliseconds(0));
}

std::uint16_t HttpServer::port() const {
  return impl_->bound_port;
}

std::size_t HttpServer::connections() const {
  return impl_->census.open();
}

std::size_t HttpServer::waiting() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->parked;
}

void HttpServer::stop(std::chrono::milliseconds grace) {
  if (impl_->stopping.exchange(true)) return;
  impl_->acceptor->stop();
  impl_->lobby.ring_all();
  {
    std::unique_lock lock(impl_->mutex);
    impl_->changed.wait_for(lock, grace,
                            [&] { return impl_->active.empty() && impl_->parked == 0; });
    for (const int fd : impl_->active) ::shutdown(fd, SHUT_RDWR);
  }
  impl_->lobby.stop();
  impl_->pool.stop();
}

}  // namespace kiln::http
