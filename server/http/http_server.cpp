#include "server/http/http_server.h"

#include <sys/socket.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "server/base/ids.h"
#include "server/base/log.h"
#include "server/http/event_streams.h"
#include "server/http/exchange.h"
#include "server/http/listener.h"
#include "server/http/problem.h"
#include "server/http/waiting_connections.h"
#include "server/http/worker_pool.h"

namespace kiln::http {
namespace {

using ExchangePtr = std::shared_ptr<Exchange>;
using ConnectionPtr = std::shared_ptr<Connection>;
using End = WaitingConnections::End;
using Moved = Exchange::Moved;

// These threads wait for the disk at most, so a few of them serve many slow clients and some fast
// ones.
constexpr unsigned kTransferThreads = 8;
// One transfer moves at most this many bytes in its turn.
constexpr std::size_t kTransferTurn = std::size_t{4} << 20;
// A request thread moves this many bytes by itself: a short body, a short answer.
constexpr std::size_t kRequestTurn = std::size_t{64} << 10;

std::string refusal(const char* code) {
  const std::string_view what = code;
  const std::string text = what == "request_timeout" ? "The request's head did not arrive in time."
                           : what == "overloaded"    ? "The service has too many connections."
                           : what == "too_many_connections"
                               ? "Too many connections of this address are open."
                               : "The request's head is over 32 KiB.";
  return raw_problem({code, text, {}}, base::new_id("req_"));
}

}  // namespace

struct HttpServer::Impl {
  Impl(HttpOptions o, Handler h, Loop& the_loop, EventStreams& the_streams)
      : options(std::move(o)),
        handler(std::move(h)),
        loop(the_loop),
        streams(the_streams),
        connections(options.limits.connections, options.limits.connections_per_peer),
        uploads_of_peers(0, options.limits.uploads_per_peer),
        uploads_of_tenants(0, options.limits.uploads_per_tenant),
        waiting(
            loop, options.limits, [this](ConnectionPtr c) { on_head(std::move(c)); }, &refusal),
        pool(options.threads, options.limits.waiting),
        transfers(kTransferThreads, 0) {}
  ~Impl() {  // their threads use what stands before them
    transfers.stop();
    pool.stop();
  }

  const HttpOptions options;
  const Handler handler;
  Loop& loop;
  EventStreams& streams;
  std::atomic<bool> stopping{false};
  std::mutex mutex;
  std::condition_variable changed;
  std::set<int> active;    ///< sockets of running requests; guarded by mutex
  std::size_t parked = 0;  ///< requests whose answer comes later; guarded by mutex
  ConcurrencyLimiter connections, uploads_of_peers, uploads_of_tenants;
  WaitingConnections waiting;
  WorkerPool pool, transfers;
  std::unique_ptr<Listener> listener;

  class ActiveScope;
  void take(proto::Fd);
  void on_head(ConnectionPtr);
  void begin(const ConnectionPtr&);
  void go_on(const ExchangePtr&);
  bool receive(const ExchangePtr&);
  bool admit_upload(Exchange&);
  void await_body(const ExchangePtr&);
  void pump_body(const ExchangePtr&);
  void end_body(const ExchangePtr&);
  void park(const ExchangePtr&);
  void resume(const ExchangePtr&, End);
  void answer(const ExchangePtr&);
  void hand_to_streams(Exchange&);
  void send(const ExchangePtr&, std::size_t most);
  void pump_answer(const ExchangePtr&);
  void await_room(const ExchangePtr&);
  void finish(Exchange&);
  void log_gone(Exchange&) const;
  void count(const Exchange&) const;
  void log_request(const Exchange&) const;
  bool wait_for_requests(std::chrono::milliseconds);
  void stop(std::chrono::milliseconds grace);
};

/// Counts a request among the active ones as long as a thread or a transfer is at it.
class HttpServer::Impl::ActiveScope {
 public:
  ActiveScope(Impl& impl, int fd) : impl_(impl), fd_(fd) {
    const std::lock_guard lock(impl_.mutex);
    impl_.active.insert(fd_);
  }
  ~ActiveScope() {
    {
      const std::lock_guard lock(impl_.mutex);
      impl_.active.erase(fd_);
    }
    impl_.changed.notify_all();
  }
  ActiveScope(const ActiveScope&) = delete;
  ActiveScope& operator=(const ActiveScope&) = delete;

 private:
  Impl& impl_;
  const int fd_;
};

void HttpServer::Impl::take(proto::Fd fd) {
  auto [permit, refused] = connections.enter(peer_network(fd.get()));
  auto connection = std::make_shared<Connection>(std::move(fd), options.limits, std::move(permit));
  using Refusal = ConcurrencyLimiter::Refusal;
  if (refused == Refusal::kNone) return waiting.await_head(std::move(connection), /*fresh=*/true);
  connection->write_at_once(
      refusal(refused == Refusal::kFull ? "overloaded" : "too_many_connections"));
  waiting.linger(std::move(connection));
}

void HttpServer::Impl::on_head(ConnectionPtr connection) {
  if (pool.enqueue([this, connection] { begin(connection); })) return;
  connection->write_at_once(refusal("overloaded"));
  waiting.linger(std::move(connection));
}

void HttpServer::Impl::begin(const ConnectionPtr& connection) {
  auto head = parse_head(connection->take_head());
  const std::string id = base::new_id("req_");
  const base::LogRequest context(id);
  if (!head) {
    log_line(base::LogLevel::kInfo, "request",
             {{"remote", connection->peer_address()}, {"code", head.error().code}});
    connection->write_at_once(raw_problem(head.error(), id));
    return waiting.linger(connection);
  }
  const auto exchange = std::make_shared<Exchange>(connection, std::move(*head), id);
  exchange->active = std::make_shared<ActiveScope>(*this, connection->fd());
  exchange->ask(handler, waiting);
  go_on(exchange);
}

// Runs on a request thread and goes as far as the response lets it.
void HttpServer::Impl::go_on(const ExchangePtr& exchange) {
  while (exchange->response.receive) {
    if (!admit_upload(*exchange)) break;
    if (exchange->begin_body() && !receive(exchange)) return;
    exchange->ask_with_body(waiting);
  }
  // A request that has waited already and would wait again must not turn in a circle when all are
  // woken.
  Response& response = exchange->response;
  if (response.deferred && stopping && exchange->was_parked)
    response = problem({"draining", "The service is going.", {}}, exchange->request);
  if (response.deferred) return park(exchange);
  answer(exchange);
}

// A body that is there already takes no share of anything.
bool HttpServer::Impl::admit_upload(Exchange& exchange) {
  if (exchange.has_whole_body()) return true;
  const auto refuse = [&](const std::string& what) {
    exchange.response =
        problem({"too_many_uploads", what + " Send this one later.", {}}, exchange.request);
    return false;
  };
  exchange.of_peer = uploads_of_peers.enter(peer_network(exchange.connection->fd())).permit;
  if (!exchange.of_peer)
    return refuse("This address is sending " + std::to_string(options.limits.uploads_per_peer) +
                  " bodies at a time, which is the limit.");
  exchange.of_tenant = uploads_of_tenants.enter(exchange.request.principal.tenant).permit;
  if (exchange.of_tenant) return true;
  exchange.of_peer.reset();
  return refuse("This tenant is sending " + std::to_string(options.limits.uploads_per_tenant) +
                " bodies at a time, which is the limit.");
}

// Takes what is there. Returns false when the rest is waited for.
bool HttpServer::Impl::receive(const ExchangePtr& exchange) {
  switch (exchange->receive(kRequestTurn)) {
    case Moved::kAll:
      return true;
    case Moved::kBlocked:
      await_body(exchange);
      return false;
    case Moved::kMore:
      transfers.enqueue_again([this, exchange] { pump_body(exchange); });
      return false;
  }
  return true;
}

void HttpServer::Impl::await_body(const ExchangePtr& exchange) {
  const EdgeLimits& limits = options.limits;
  exchange->connection->deadline = exchange->clock.deadline(limits, limits.read_idle);
  exchange->begin_wait();
  waiting.await(exchange->connection, WaitingConnections::For::kBytes, [this, exchange](End end) {
    exchange->end_wait();
    if (end == End::kReady)
      return transfers.enqueue_again([this, exchange] { pump_body(exchange); });
    exchange->fail_slow_body();
    end_body(exchange);
  });
}

void HttpServer::Impl::pump_body(const ExchangePtr& exchange) {
  const base::LogRequest context(exchange->request.id);
  switch (exchange->receive(kTransferTurn)) {
    case Moved::kAll:
      return end_body(exchange);
    case Moved::kBlocked:
      return await_body(exchange);
    case Moved::kMore:
      return transfers.enqueue_again([this, exchange] { pump_body(exchange); });
  }
}

void HttpServer::Impl::end_body(const ExchangePtr& exchange) {
  pool.enqueue_again([this, exchange] {
    const base::LogRequest context(exchange->request.id);
    exchange->ask_with_body(waiting);
    go_on(exchange);
  });
}

void HttpServer::Impl::park(const ExchangePtr& exchange) {
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
  exchange->was_parked = true;
  exchange->connection->deadline = exchange->response.deferred->until;
  exchange->active.reset();
  const auto since = Exchange::Clock::now();
  waiting.park(exchange->connection, exchange->waker, [this, exchange, since](End end) {
    // The client did not ask for the time from now on.
    exchange->request.asleep += Exchange::Clock::now() - since;
    pool.enqueue_again([this, exchange, end] { resume(exchange, end); });
  });
}

void HttpServer::Impl::resume(const ExchangePtr& exchange, End end) {
  const base::LogRequest context(exchange->request.id);
  if (end == End::kGone) return log_gone(*exchange);
  exchange->active = std::make_shared<ActiveScope>(*this, exchange->connection->fd());
  exchange->parked.reset();
  exchange->ask_again(waiting);
  go_on(exchange);
}

void HttpServer::Impl::answer(const ExchangePtr& exchange) {
  count(*exchange);
  exchange->begin_answer(/*last=*/stopping);
  if (exchange->response.stream) return hand_to_streams(*exchange);
  send(exchange, kRequestTurn);
}

void HttpServer::Impl::hand_to_streams(Exchange& exchange) {
  log_request(exchange);
  exchange.active.reset();
  StreamContent& content = *exchange.response.stream;
  streams.adopt({exchange.connection->release(), std::move(content.ring), content.after,
                 std::move(content.intro), exchange.connection->release_permit(),
                 exchange.head_of_stream()});
}

void HttpServer::Impl::send(const ExchangePtr& exchange, std::size_t most) {
  switch (exchange->send(most)) {
    case Moved::kAll:
      return finish(*exchange);
    case Moved::kBlocked:
      return await_room(exchange);
    case Moved::kMore:
      return transfers.enqueue_again([this, exchange] { pump_answer(exchange); });
  }
}

void HttpServer::Impl::pump_answer(const ExchangePtr& exchange) {
  const base::LogRequest context(exchange->request.id);
  send(exchange, kTransferTurn);
}

void HttpServer::Impl::await_room(const ExchangePtr& exchange) {
  const EdgeLimits& limits = options.limits;
  exchange->connection->deadline = exchange->clock.deadline(limits, limits.write_idle);
  exchange->begin_wait();
  waiting.await(exchange->connection, WaitingConnections::For::kRoom, [this, exchange](End end) {
    exchange->end_wait();
    if (end == End::kLate) exchange->give_up_answer();
    transfers.enqueue_again([this, exchange] { pump_answer(exchange); });
  });
}

void HttpServer::Impl::finish(Exchange& exchange) {
  log_request(exchange);
  exchange.active.reset();  // the connection's number may be another's from here on
  if (exchange.keeps_connection() && !stopping)
    waiting.await_head(exchange.connection, /*fresh=*/false);
  else
    waiting.linger(exchange.connection);
}

// Logs a request whose client is gone. Its status, 499, is one that no answer ever has.
void HttpServer::Impl::log_gone(Exchange& exchange) const {
  constexpr int kClientGone = 499;
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
  const auto milliseconds = [](Exchange::Clock::duration time) {
    return std::round(std::chrono::duration<double, std::micro>(time).count()) / 1000;
  };
  const auto own = exchange.own_time();
  const bool slow = options.slow.count() > 0 && own >= options.slow;
  log_line(slow ? base::LogLevel::kWarn : base::LogLevel::kInfo, slow ? "request.slow" : "request",
           {{"server", options.name},
            {"method", exchange.head.method},
            {"path", exchange.head.path},
            {"status", exchange.response.status},
            {"bytes", exchange.bytes_written()},
            {"ms", milliseconds(exchange.time())},
            {"own_ms", milliseconds(own)},
            {"remote", exchange.connection->peer_address()}});
}

bool HttpServer::Impl::wait_for_requests(std::chrono::milliseconds time) {
  std::unique_lock lock(mutex);
  return changed.wait_for(lock, time, [&] { return active.empty() && parked == 0; });
}

void HttpServer::Impl::stop(std::chrono::milliseconds grace) {
  // The transfers that are cut get this time to end as others do, and flush what came of an upload.
  constexpr std::chrono::milliseconds kEnding{1'000};
  if (stopping.exchange(true)) return;
  listener->close();
  waiting.wake_all();
  if (!wait_for_requests(grace)) {
    {
      const std::lock_guard lock(mutex);
      for (const int fd : active) ::shutdown(fd, SHUT_RDWR);
    }
    wait_for_requests(kEnding);
  }
  waiting.close();
  transfers.stop();
  pool.stop();
}

proto::Expected<std::unique_ptr<HttpServer>> HttpServer::start(HttpOptions options, Handler handler,
                                                               Loop& loop, EventStreams& streams) {
  auto impl = std::make_unique<Impl>(std::move(options), std::move(handler), loop, streams);
  auto listener = Listener::open(loop, impl->options.name, impl->options.listen, impl->options.port,
                                 [self = impl.get()](proto::Fd fd) { self->take(std::move(fd)); });
  if (!listener) return proto::Unexpected(listener.error());
  impl->listener = std::move(*listener);
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() {
  stop(std::chrono::milliseconds(0));
}

std::uint16_t HttpServer::port() const {
  return impl_->listener->port();
}

std::size_t HttpServer::connections() const {
  return impl_->connections.open();
}

std::size_t HttpServer::uploads() const {
  return impl_->uploads_of_peers.open();
}

std::size_t HttpServer::waiting() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->parked;
}

void HttpServer::stop(std::chrono::milliseconds grace) {
  impl_->stop(grace);
}

}  // namespace kiln::http
