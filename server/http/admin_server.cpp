#include "server/http/admin_server.h"

#include <fcntl.h>
#include <httplib.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "proto/files.h"
#include "server/base/ids.h"
#include "server/base/log.h"
#include "server/http/problem.h"
#include "server/http/worker_pool.h"

namespace kiln::http {
namespace {

using Clock = std::chrono::steady_clock;

constexpr unsigned kThreads = 32;
constexpr std::size_t kMaxWaiting = 256;                  // then connections wait in the kernel
constexpr std::chrono::milliseconds kRequestTime{2'000};  // longest time of a request
constexpr std::chrono::seconds kSilence{1};               // longest time between two pieces of it
constexpr int kBacklog = 256;

/// Returns the port of a connection that this process accepted; 0 for other descriptors.
std::uint16_t accepted_at(int fd) {
  int listens = 1;
  socklen_t size = sizeof listens;
  if (::getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &size) != 0 || listens != 0) return 0;
  sockaddr_storage address{};
  size = sizeof address;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  if (address.ss_family == AF_INET) return ntohs(reinterpret_cast<sockaddr_in&>(address).sin_port);
  if (address.ss_family != AF_INET6) return 0;
  return ntohs(reinterpret_cast<sockaddr_in6&>(address).sin6_port);
}

// Returns whether all that has arrived was read. A request that waits for a thread was not read.
bool was_read(int fd) {
  int unread = 0;
  return ::ioctl(fd, FIONREAD, &unread) == 0 && unread == 0;
}

/// Cuts connections of one port that take too long. The library does not tell its sockets, so they
/// are found by their port.
class SlowConnections {
 public:
  explicit SlowConnections(std::uint16_t port) : port_(port) {}

  // This looks at a copy: the descriptor's number may be another file's by now, the copy can't.
  void look() {
    std::map<ino_t, Clock::time_point> now;
    std::error_code error;
    for (std::filesystem::directory_iterator at("/proc/self/fd", error), end; !error && at != end;
         at.increment(error)) {
      const int number = std::atoi(at->path().filename().c_str());
      const proto::Fd copy(::fcntl(number, F_DUPFD_CLOEXEC, 0));
      struct stat info {};
      if (!copy.valid() || accepted_at(copy.get()) != port_ || ::fstat(copy.get(), &info) != 0)
        continue;
      const auto known = seen_.find(info.st_ino);
      const auto since = known == seen_.end() ? Clock::now() : known->second;
      now.emplace(info.st_ino, since);
      // Slow clients come first. A client that sends without an end is never read to its end.
      const auto time = Clock::now() - since;
      if (time > (was_read(copy.get()) ? kRequestTime / 2 : kRequestTime))
        ::shutdown(copy.get(), SHUT_RDWR);
    }
    seen_.swap(now);
  }
  void forget() { seen_.clear(); }

 private:
  const std::uint16_t port_;
  std::map<ino_t, Clock::time_point> seen_;  ///< sockets by their inodes, since when
};

/// The library's requests, on threads with known stacks, each for a limited time.
class BoundedTasks final : public httplib::TaskQueue {
 public:
  explicit BoundedTasks(std::uint16_t port)
      : pool_(kThreads, 0), watch_([this, port](const std::stop_token& stop) {
          SlowConnections slow(port);
          std::unique_lock lock(mutex_);
          while (!stop.stop_requested()) {
            changed_.wait_for(lock, stop, kRequestTime / 8, [] { return false; });
            const bool some = !begun_.empty() && Clock::now() - *begun_.begin() > kRequestTime / 4;
            lock.unlock();
            some ? slow.look() : slow.forget();
            lock.lock();
          }
        }) {}

  // Waits for room, because the library's task owns a socket and can't be refused.
  void enqueue(std::function<void()> task) override {
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return open_ < kMaxWaiting; });
      ++open_;
    }
    pool_.enqueue_again([this, task = std::move(task)] { run(task); });
  }
  void shutdown() override { pool_.stop(); }

 private:
  void run(const std::function<void()>& task) {
    std::multiset<Clock::time_point>::iterator began;
    {
      const std::lock_guard lock(mutex_);
      began = begun_.insert(Clock::now());
    }
    try {
      task();
    } catch (const std::exception& e) {
      log_line(base::LogLevel::kError, "http.exception", {{"server", "admin"}, {"what", e.what()}});
    }
    {
      const std::lock_guard lock(mutex_);
      begun_.erase(began);
      --open_;
    }
    changed_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::size_t open_ = 0;                    ///< guarded by mutex_
  std::multiset<Clock::time_point> begun_;  ///< guarded by mutex_
  WorkerPool pool_;
  std::jthread watch_;
};

void set(int fd, int level, int option, int value) {
  ::setsockopt(fd, level, option, &value, sizeof value);
}

}  // namespace

struct AdminServer::Impl {
  Impl(std::string a, AdminPages p) : address(std::move(a)), pages(std::move(p)) {
    server.set_tcp_nodelay(true);
    server.set_keep_alive_max_count(1);
    server.set_keep_alive_timeout(kSilence.count());
    server.set_read_timeout(kSilence);
    server.set_write_timeout(kRequestTime);
    server.set_socket_options([this](socket_t fd) { set_options(fd); });
    server.new_task_queue = [this] { return new BoundedTasks(port); };
    server.set_pre_routing_handler(&Impl::refuse);
    for (const auto& [path, page] : pages)
      server.Get(path, [make = &page](const httplib::Request& request, httplib::Response& out) {
        answer(request, out, *make);
      });
    server.set_error_handler([](const httplib::Request& request, httplib::Response& out) {
      if (!out.has_header("X-Request-Id")) answer_error(request, out);
    });
  }

  httplib::Server server;
  const std::string address;
  const AdminPages pages;
  std::uint16_t port = 0;
  std::atomic<int> listener{-1};
  std::atomic<bool> stopping{false}, ended{false};
  std::thread thread;

  // Connections inherit these from the listener: none is accepted before its first byte is there,
  // and what a client may send ahead is little. Not SO_REUSEPORT, which is the library's default.
  void set_options(int fd) {
    set(fd, SOL_SOCKET, SO_REUSEADDR, 1);
    set(fd, SOL_SOCKET, SO_RCVBUF, 1);
    set(fd, IPPROTO_TCP, TCP_DEFER_ACCEPT, static_cast<int>(kSilence.count()));
    ::fcntl(fd, F_SETFD, FD_CLOEXEC);
    listener = fd;
  }

  bool bind(std::uint16_t wanted) {
    const int bound = wanted == 0                            ? server.bind_to_any_port(address)
                      : server.bind_to_port(address, wanted) ? wanted
                                                             : -1;
    if (bound <= 0) return false;
    port = static_cast<std::uint16_t>(bound);
    ::listen(listener, kBacklog);  // the library asks for five
    return true;
  }

  // The library's loop ends at the first error of accept(), so it is started again.
  void run() {
    while (!stopping) {
      server.listen_after_bind();
      while (!stopping && !bind(port)) std::this_thread::sleep_for(std::chrono::milliseconds(200));
    }
    ended = true;
  }

  // Only what has no body goes on: the library would read any.
  static httplib::Server::HandlerResponse refuse(const httplib::Request& request,
                                                 httplib::Response& out) {
    if (request.method == "GET" || request.method == "HEAD")
      return httplib::Server::HandlerResponse::Unhandled;
    out.status = 405;
    out.set_header("Allow", "GET, HEAD");
    return httplib::Server::HandlerResponse::Handled;
  }

  static void fill(const Response& response, const std::string& id, httplib::Response& out) {
    out.status = response.status;
    for (const auto& [name, value] : response.headers) out.set_header(name, value);
    out.set_header("X-Request-Id", id);
    out.set_content(response.body, response.content_type);
  }

  static void answer(const httplib::Request& request, httplib::Response& out,
                     const std::function<Response()>& page) {
    const auto began = Clock::now();
    const std::string id = base::new_id("req_");
    const base::LogRequest context(id);
    Response response;
    try {
      response = page();
    } catch (const std::exception& e) {
      log_line(base::LogLevel::kError, "http.exception",
               {{"path", request.path}, {"what", e.what()}});
      response = problem({"internal", "The service failed at this request; its log says more.", {}},
                         id, request.path);
    }
    fill(response, id, out);
    log(request, out.status, began);
  }

  static void answer_error(const httplib::Request& request, httplib::Response& out) {
    const std::string id = base::new_id("req_");
    const base::LogRequest context(id);
    const char* code = out.status == 405   ? "method_not_allowed"
                       : out.status == 404 ? "not_found"
                                           : "bad_request";
    const char* what = out.status == 405   ? "The admin port knows GET and HEAD only."
                       : out.status == 404 ? "The admin port has /healthz, /readyz and /metrics."
                                           : "The request is malformed.";
    fill(problem({code, what, {}}, id, request.path), id, out);
    log(request, out.status, Clock::now());
  }

  static void log(const httplib::Request& request, int status, Clock::time_point began) {
    const std::chrono::duration<double, std::milli> time = Clock::now() - began;
    log_line(base::LogLevel::kInfo, "request",
             {{"server", "admin"},
              {"method", request.method},
              {"path", request.path},
              {"status", status},
              {"ms", std::round(time.count() * 1000) / 1000},
              {"remote", request.remote_addr}});
  }
};

proto::Expected<std::unique_ptr<AdminServer>> AdminServer::start(const std::string& address,
                                                                 std::uint16_t port,
                                                                 AdminPages pages) {
  auto impl = std::make_unique<Impl>(address, std::move(pages));
  if (!impl->bind(port))
    return proto::fail("cannot_listen", "Could not listen on " + address + ":" +
                                            std::to_string(port) +
                                            ": the address is in use or not ours.");
  impl->thread = std::thread([self = impl.get()] { self->run(); });
  return std::unique_ptr<AdminServer>(new AdminServer(std::move(impl)));
}

AdminServer::AdminServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

AdminServer::~AdminServer() {
  stop();
}

std::uint16_t AdminServer::port() const {
  return impl_->port;
}

// The library can only be stopped once it runs, which its thread is about to do.
void AdminServer::stop() {
  if (impl_->stopping.exchange(true)) return;
  while (!impl_->server.is_running() && !impl_->ended) std::this_thread::yield();
  impl_->server.stop();
  impl_->thread.join();
}

}  // namespace kiln::http
