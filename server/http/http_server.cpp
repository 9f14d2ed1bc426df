#include "server/http/http_server.h"

#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <new>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "server/http/hub.h"
#include "server/http/lobby.h"
#include "server/http/problem.h"
#include "server/http/worker_pool.h"
#include "server/jobs/ids.h"
#include "server/log.h"
#include "server/storage/sqlite.h"

namespace kiln::server {
namespace {

constexpr int kBacklog = 1024;
constexpr std::size_t kMaxWaiting = 1024;  // requests that wait for a thread

/// One request and its answer on a connection.
struct Exchange {
  Connection& connection;
  RequestHead head;
  BodyReader body;
  std::string request_id;
  std::string forwarded;  ///< the head that the library may see
  std::size_t forwarded_at = 0;
  bool close = false;
  bool hand_over = false;  ///< to the hub
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
  Request request{exchange.head, exchange.body, exchange.request_id, {}, {}, {}};
  const auto report = [&](const char* what) {
    log_line(LogLevel::kError, "http.exception",
             {{"request_id", request.id}, {"path", exchange.head.path}, {"what", what}});
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
        pool(options.threads, kMaxWaiting),
        lobby(
            options.limits, [this](std::unique_ptr<Connection> c) { on_head(std::move(c)); },
            [](const char* code) { return refusal(code); }) {}

  HttpOptions options;
  server::Handler handler;
  Hub& hub;
  WorkerPool pool;
  Lobby lobby;
  std::thread accept_thread;
  std::atomic<bool> stopping{false};
  std::atomic<int> listener{-1};
  std::uint16_t bound_port = 0;
  std::mutex mutex;
  std::condition_variable changed;
  std::set<int> active;  ///< sockets of running requests; guarded by mutex

  /// The accept thread only hands sockets on, so its "pool" is itself.
  struct Inline final : httplib::TaskQueue {
    void enqueue(std::function<void()> task) override { task(); }
    void shutdown() override {}
  };

  bool configure();
  bool bind();
  void accept_loop();
  bool process_and_close_socket(socket_t fd) override;
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
                                                     : "The request's head is over 32 KiB.";
  return raw_problem({code, text, {}}, new_id("req_"));
}

bool HttpServer::Impl::configure() {
  new_task_queue = [] { return new Inline; };
  set_tcp_nodelay(true);
  // The library's default is SO_REUSEPORT: two servers would share a port and its traffic.
  set_socket_options([this](socket_t fd) {
    const int yes = 1;
    ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    listener = fd;
  });
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
  return bind();
}

bool HttpServer::Impl::bind() {
  if (bound_port == 0 && options.port == 0) {
    const int port = bind_to_any_port(options.listen);
    if (port <= 0) return false;
    bound_port = static_cast<std::uint16_t>(port);
  } else {
    const std::uint16_t port = bound_port ? bound_port : options.port;
    if (!bind_to_port(options.listen, port)) return false;
    bound_port = port;
  }
  // The library asks for a backlog of 5, which drops connections in a burst.
  return ::listen(listener, kBacklog) == 0;
}

// accept() fails for good on rare errors (ENFILE, ENOMEM): then bind again, unless we are stopping.
void HttpServer::Impl::accept_loop() {
  for (;;) {
    listen_after_bind();
    while (!stopping) {
      log_line(LogLevel::kError, "http.listen",
               {{"server", options.name}, {"what", "accepting failed; binding again"}});
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      if (bind()) break;
    }
    if (stopping) return;
  }
}

bool HttpServer::Impl::process_and_close_socket(socket_t fd) {
  lobby.adopt(std::make_unique<Connection>(proto::Fd(fd), options.limits), /*fresh=*/true);
  return true;
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
  bool handed_over = false;
  const bool keep = exchange_once(*connection, handed_over);
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
  log_line(
      LogLevel::kInfo, "request",
      {{"request_id", id}, {"remote", connection.peer_address()}, {"code", head.error().code}});
  connection.write(raw_problem(head.error(), id));
  return false;
}

bool HttpServer::Impl::answer(Connection& connection, RequestHead head, bool& handed_over) {
  const auto began = Connection::Clock::now();
  Exchange exchange(connection, std::move(head), new_id("req_"));
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
    hub.adopt(
        {connection.release(), std::move(content.ring), content.after, std::move(content.intro)});
    handed_over = true;
  }
  return ok && !exchange.close && !stream.broken();
}

void HttpServer::Impl::log_request(const Exchange& exchange,
                                   Connection::Clock::time_point began) const {
  const std::chrono::duration<double, std::milli> time = Connection::Clock::now() - began;
  log_line(LogLevel::kInfo, "request",
           {{"request_id", exchange.request_id},
            {"server", options.name},
            {"method", exchange.head.method},
            {"path", exchange.head.path},
            {"status", exchange.response.status},
            {"bytes", exchange.connection.bytes_written()},
            {"ms", std::round(time.count() * 1000) / 1000},
            {"remote", exchange.connection.peer_address()}});
}

proto::Expected<std::unique_ptr<HttpServer>> HttpServer::start(HttpOptions options, Handler handler,
                                                               Hub& hub) {
  auto impl = std::make_unique<Impl>(std::move(options), std::move(handler), hub);
  if (!impl->configure())
    return proto::fail("cannot_listen", "Could not listen on " + impl->options.listen + ":" +
                                            std::to_string(impl->options.port) +
                                            ": the address is in use or not ours.");
  impl->accept_thread = std::thread([self = impl.get()] { self->accept_loop(); });
  return std::unique_ptr<HttpServer>(new HttpServer(std::move(impl)));
}

HttpServer::HttpServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

HttpServer::~HttpServer() {
  stop(std::chrono::milliseconds(0));
}

std::uint16_t HttpServer::port() const {
  return impl_->bound_port;
}

void HttpServer::stop(std::chrono::milliseconds grace) {
  if (!impl_->accept_thread.joinable()) return;
  impl_->stopping = true;
  // Not Server::stop(): that would also cut the answers which are being written.
  ::shutdown(impl_->listener, SHUT_RDWR);
  impl_->accept_thread.join();
  {
    std::unique_lock lock(impl_->mutex);
    impl_->changed.wait_for(lock, grace, [&] { return impl_->active.empty(); });
    for (const int fd : impl_->active) ::shutdown(fd, SHUT_RDWR);
  }
  impl_->lobby.stop();
  impl_->pool.stop();
}

}  // namespace kiln::server
