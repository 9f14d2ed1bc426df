#include "server/http/listener.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstring>
#include <new>
#include <nlohmann/json.hpp>

#include "server/base/log.h"
#include "server/http/listen.h"

namespace kiln::http {
namespace {

using std::chrono::milliseconds;

constexpr int kAcceptsPerTurn = 64;  // others wait for their turn meanwhile

std::uint16_t port_of(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return ntohs(address.ss_family == AF_INET6
                   ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                   : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

// Returns whether accept() failed because the machine is short of something, which passes.
bool is_shortage(int error) {
  return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM;
}

bool is_lasting(int error) {
  return error == EBADF || error == EINVAL || error == ENOTSOCK || error == EOPNOTSUPP;
}

}  // namespace

Listener::Listener(Loop& loop, std::string name, std::string address, Take take)
    : loop_(loop), name_(std::move(name)), address_(std::move(address)), take_(std::move(take)) {}

proto::Expected<std::unique_ptr<Listener>> Listener::open(Loop& loop, std::string name,
                                                          std::string address, std::uint16_t port,
                                                          Take take) {
  std::unique_ptr<Listener> made(
      new Listener(loop, std::move(name), std::move(address), std::move(take)));
  if (!made->bind(port))
    return proto::fail("cannot_listen", "Could not listen on " + made->address_ + ":" +
                                            std::to_string(port) +
                                            ": the address is in use or not ours.");
  made->again_ = Loop::Clock::time_point::min();  // the loop takes the socket in at once
  loop.attach(*made);
  return made;
}

Listener::~Listener() {
  close();
}

void Listener::close() {
  loop_.detach(*this);
}

void Listener::on_detach() noexcept {
  if (watched_) loop_.remove(id_, socket_.get());
  watched_ = false;
  again_ = Loop::Clock::time_point::max();
  socket_.reset();
}

bool Listener::bind(std::uint16_t port) {
  socket_.reset();
  socket_ = listen_on(address_, port);
  if (!socket_.valid()) return false;
  if (port_ == 0) port_ = port_of(socket_.get());  // a socket bound again keeps its port
  return true;
}

void Listener::suspend(milliseconds time) {
  if (watched_) loop_.remove(id_, socket_.get());
  watched_ = false;
  again_ = Loop::Clock::now() + time;
}

void Listener::resume() {
  id_ = loop_.add(socket_.get(), EPOLLIN, *this);
  watched_ = true;
  again_ = Loop::Clock::time_point::max();
}

// A service that can't be reached is of no use: it binds again until it can.
void Listener::on_time(Loop::Clock::time_point) {
  constexpr milliseconds kRebind{200};
  if (socket_.valid()) return resume();
  if (!bind(port_)) return suspend(kRebind);
  log_line(base::LogLevel::kWarn, "http.rebound", {{"server", name_}, {"port", port_}});
  resume();
}

void Listener::on_events(Loop::Id, std::uint32_t) {
  for (int i = 0; i < kAcceptsPerTurn; ++i) {
    proto::Fd fd(::accept4(socket_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!fd.valid()) return on_failure(errno);
    const int yes = 1;
    ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    try {
      take_(std::move(fd));
    } catch (const std::bad_alloc&) {  // that connection is closed; the next may find memory
    }
  }
}

void Listener::on_failure(int error) {
  constexpr milliseconds kShortage{100};
  if (is_lasting(error)) {
    log_line(
        base::LogLevel::kError, "http.listen",
        {{"server", name_}, {"what", std::strerror(error)}, {"then", "The listener binds again."}});
    suspend(milliseconds(0));
    socket_.reset();
  } else if (is_shortage(error)) {
    log_line(base::LogLevel::kWarn, "http.accept",
             {{"server", name_}, {"what", std::strerror(error)}});
    suspend(kShortage);
  }  // others are errors of one connection, or say that no more are there
}

}  // namespace kiln::http
