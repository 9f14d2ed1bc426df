#include "server/http/http_server.h"

#include <httplib.h>
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

#include "server/http/acceptor.h"
#include "server/http/hub.h"
#include "server/http/lobby.h"
#include "server/http/problem.h"
#include "server/http/worker_pool.h"
#include "server/jobs/ids.h"
#include "server/log.h"
#include "server/storage/sqlite.h"

namespace kiln::server {
namespace {

/// One request and its answer on a connection.
struct Exchange {
  Connection& connection;
  RequestHead head;
  BodyReader body;
  std::string request_id;
  std::string forwarded;  ///< the head that the library may see
  std::size_t forwarded_at = 0;
  bool close = false;
  bool hand_over = false;                ///< to the hub
  Connection::Clock::duration asleep{};  ///< because the client asked to wait
  Response response;

  Exchange(Connection& c, RequestHead h, std::string id)
      : connection(c),
        head(std::move(h)),
        body(head, [this](char* out, std::size_t n) { return read_body(out, n); }),
        request_id(std::move(id)) {
    // The library decodes, splits and matches header values by rules of its own (percent signs,
    // regular expressions for Range): it gets the method and nothing else.
    forwarded = head.method + " / HTTP/1.1\r\n\r\n";
  }
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  ssize_t read_body(char* out, std::size_t n) {
    const std::string* expect = head.header("expect");
    const bool asked = expect && equal_ignoring_case(*expect, "100-continue");
    if (asked && !continued_ && !connection.has_bytes())
      connection.write("HTTP/1.1 100 Continue\r\n\r\n");
    continued_ = true;
    return connection.read(out, n);
  }

 private:
  bool continued_ = false;
};

/// The exchange as the library's stream: the checked head in, the answer out.
class ExchangeStream final : public httplib::Stream {
 public:
  explicit ExchangeStream(Exchange& exchange) : exchange_(exchange) {}
  bool is_readable() const override { return true; }
  bool is_writable() const override { return !broken_; }
  ssize_t read(char* out, std::size_t n) override {
    const std::size_t left = exchange_.forwarded.size() - exchange_.forwarded_at;
    const std::size_t take = std::min(n, left);
    std::copy_n(exchange_.forwarded.data() + exchange_.forwarded_at, take, out);
    exchange_.forwarded_at += take;
    return static_cast<ssize_t>(take);
  }
  ssize_t write(const char* bytes, std::size_t n) override {
    if (broken_ || !exchange_.connection.write({bytes, n})) {
      broken_ = true;
      return -1;
    }
    return static_cast<ssize_t>(n);
  }
  void get_remote_ip_and_port(std::string& ip, int& port) const override {
    ip = exchange_.connection.peer_address();
    port = exchange_.connection.peer_port();
  }
  void get_local_ip_and_port(std::string& ip, int& port) const override {
    ip.clear();
    port = 0;
  }
  socket_t socket() const override { return exchange_.connection.fd(); }
  bool broken() const { return broken_; }

 private:
  Exchange& exchange_;
  bool broken_ = false;
};

thread_local Exchange* t_exchange = nullptr;

bool send_piece(const Content& content, std::size_t at, std::size_t left, httplib::DataSink& sink) {
  thread_local std::vector<char> buffer(std::size_t{256} * 1024);
  const std::int64_t got = read_content(content, at, buffer.data(), std::min(left, buffer.size()));
  return got > 0 && sink.write(buffer.data(), static_cast<std::size_t>(got));
}

void fill_answer(Exchange& exchange, httplib::Response& out) {
  Response& response = exchange.response;
  out.status = response.status;
  for (const auto& [name, value] : response.headers) out.set_header(name.c_str(), value);
  if (response.stream) {
    out.set_chunked_content_provider(response.content_type,
                                     [&exchange](std::size_t, httplib::DataSink&) {
                                       exchange.hand_over = true;  // the head is out, no body byte
                                       return false;
                                     });
  } else if (!response.content.empty()) {
    out.set_content_provider(
        length_of(response.content), response.content_type,
        [content = response.content](std::size_t at, std::size_t left, httplib::DataSink& sink) {
          return send_piece(content, at, left, sink);
        });
  } else if (!response.content_type.empty()) {
    out.set_content(response.body, response.content_type);
  }
}

Response call(const server::Handler& handler, Exchange& exchange) {
  Request request{exchange.head, exchange.body, exchange.request_id, {}, {}, {}, exchange.asleep};
  const auto report = [&](const char* what) {
    log_line(LogLevel::kError, "http.exception", {{"path", exchange.head.path}, {"what", what}});
  };
  try {
    return handler(request);
  } catch (const DatabaseError& e) {
    report(e.what());
    if (e.disk_full)
      return problem({"storage_full", "The disk of the service is full.", {}}, request);
  } catch (const std::bad_alloc&) {
    report("out of memory");
    return problem({"out_of_memory", "The service has no memory left for this request.", {}},
                   request);
  } catch (const std::exception& e) {
    report(e.what());
  } catch (...) {
    report("unknown type");
  }
  return problem({"internal", "The service failed at this request; its log says more.", {}},
                 request);
}

}  // namespace

struct HttpServer::Impl final : httplib::Server {
  Impl(HttpOptions o, server::Handler h, Hub& the_hub)
      : options(std::move(o)),
        handler(std::move(h)),
        hub(the_hub),
        census(options.limits.connections, options.limits.connections_per_peer),
        pool(options.threads, options.limits.waiting),
        lobby(
            options.limits, [this](std::unique_ptr<Connection> c) { on_head(std::move(c)); },
            [](const char* code) { return refusal(code); }) {}

  HttpOptions options;
  server::Handler handler;
  Hub& hub;
  Census census;
  WorkerPool pool;
  Lobby lobby;
  std::unique_ptr<Acceptor> acceptor;
  std::atomic<bool> stopping{false};
  std::uint16_t bound_port = 0;
  std::mutex mutex;
  std::condition_variable changed;
  std::set<int> active;  ///< sockets of running requests; guarded by mutex

  void configure();
  proto::Expected<void> listen();
  void take(proto::Fd);
  void on_head(std::unique_ptr<Connection>);
  void serve(std::unique_ptr<Connection>);
  bool exchange_once(Connection&, bool& handed_over);
  bool answer(Connection&, RequestHead, bool& handed_over);
  void log_request(const Exchange&, Connection::Clock::time_point began) const;
  static std::string refusal(const char* code);
};

std::string HttpServer::Impl::refusal(const char* code) {
  const std::string_view what = code;
  const std::string text = what == "request_timeout" ? "The request's head did not arrive in time."
                           : what == "overloaded"    ? "The service has too many connections."
                           : what == "too_many_connections"
                               ? "Too many connections of this address are open."
                               : "The request's head is over 32 KiB.";
  return raw_problem({code, text, {}}, new_id("req_"));
}

void HttpServer::Impl::configure() {
  set_pre_routing_handler([](const httplib::Request&, httplib::Response& out) {
    fill_answer(*t_exchange, out);
    return HandlerResponse::Handled;
  });
  set_post_routing_handler([](const httplib::Request&, httplib::Response& out) {
    out.headers.erase("Keep-Alive");
    out.headers.erase("Accept-Ranges");
    for (const auto& [name, value] : t_exchange->response.headers)
      if (name == "Accept-Ranges") out.set_header("Accept-Ranges", value);
    if (out.status == 304 || out.status == 204) out.headers.erase("Content-Length");
    out.set_header("X-Request-Id", t_exchange->request_id);
    if (t_exchange->close) out.set_header("Connection", "close");
  });
  set_exception_handler([](const httplib::Request&, httplib::Response& out, std::exception_ptr) {
    out.status = 500;  // filling the answer failed: out of memory
  });
}

proto::Expected<void> HttpServer::Impl::listen() {
  auto made = Acceptor::start(options.name, options.listen, options.port,
                              [this](proto::Fd fd) { take(std::move(fd)); });
  if (!made) return proto::Unexpected(made.error());
  acceptor = std::move(*made);
  bound_port = acceptor->port();
  // The library takes a server without a socket for one that shuts down, and cuts its answers.
  svr_sock_ = acceptor->fd();
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

void HttpServer::Impl::serve(std::unique_ptr<Connection> connection) {
  const int fd = connection->fd();
  {
    const std::lock_guard lock(mutex);
    active.insert(fd);
  }
  bool handed_over = false, keep = false;
  try {
    keep = exchange_once(*connection, handed_over);
  } catch (const std::bad_alloc&) {  // not even an answer could be made: the connection ends
    t_exchange = nullptr;
  }
  {
    const std::lock_guard lock(mutex);
    active.erase(fd);
  }
  if (!handed_over) {
    if (keep && !stopping)
      lobby.adopt(std::move(connection), /*fresh=*/false);
    else
      lobby.linger(std::move(connection));
  }
  changed.notify_all();
}

bool HttpServer::Impl::exchange_once(Connection& connection, bool& handed_over) {
  connection.begin_exchange();
  auto head = parse_head(connection.take_head());
  if (head) return answer(connection, std::move(*head), handed_over);
  const std::string id = new_id("req_");
  const LogRequest context(id);
  log_line(LogLevel::kInfo, "request",
           {{"remote", connection.peer_address()}, {"code", head.error().code}});
  connection.write(raw_problem(head.error(), id));
  return false;
}

bool HttpServer::Impl::answer(Connection& connection, RequestHead head, bool& handed_over) {
  const auto began = Connection::Clock::now();
  Exchange exchange(connection, std::move(head), new_id("req_"));
  const LogRequest context(exchange.request_id);
  exchange.response = call(handler, exchange);
  // What is left of a body would be read as the next request.
  exchange.close = exchange.head.wants_close() || !exchange.body.done() || stopping;
  ExchangeStream stream(exchange);
  bool ignored = false;
  t_exchange = &exchange;
  const bool ok = process_request(stream, false, ignored, nullptr);
  t_exchange = nullptr;
  log_request(exchange, began);
  if (exchange.hand_over && !stream.broken()) {
    StreamContent& content = *exchange.response.stream;
    hub.adopt({connection.release(), std::move(content.ring), content.after,
               std::move(content.intro), connection.release_place()});
    handed_over = true;
  }
  return ok && !exchange.close && !stream.broken();
}

void HttpServer::Impl::log_request(const Exchange& exchange,
                                   Connection::Clock::time_point began) const {
  const auto milliseconds = [](Connection::Clock::duration time) {
    return std::round(std::chrono::duration<double, std::micro>(time).count()) / 1000;
  };
  const auto time = Connection::Clock::now() - began;
  const auto own = time - exchange.connection.waited() - exchange.asleep;
  const bool slow = options.slow.count() > 0 && own >= options.slow;
  log_line(slow ? LogLevel::kWarn : LogLevel::kInfo, slow ? "request.slow" : "request",
           {{"server", options.name},
            {"method", exchange.head.method},
            {"path", exchange.head.path},
            {"status", exchange.response.status},
            {"bytes", exchange.connection.bytes_written()},
            {"ms", milliseconds(time)},
            {"own_ms", milliseconds(own)},
            {"remote", exchange.connection.peer_address()}});
}

proto::Expected<std::unique_ptr<HttpServer>> HttpServer::start(HttpOptions options, Handler handler,
                                                               Hub& hub) {
  auto impl = std::make_unique<Impl>(std::move(options), std::move(handler), hub);
  impl->configure();
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

void HttpServer::stop(std::chrono::milliseconds grace) {
  if (impl_->stopping.exchange(true)) return;
  impl_->acceptor->stop();
  {
    std::unique_lock lock(impl_->mutex);
    impl_->changed.wait_for(lock, grace, [&] { return impl_->active.empty(); });
    for (const int fd : impl_->active) ::shutdown(fd, SHUT_RDWR);
  }
  impl_->lobby.stop();
  impl_->pool.stop();
}

}  // namespace kiln::server
