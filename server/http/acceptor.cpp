#include "server/http/acceptor.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <new>
#include <nlohmann/json.hpp>
#include <system_error>

#include "server/base/log.h"
#include "server/http/listen.h"

namespace kiln::http {
namespace {

std::uint16_t port_of(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return ntohs(address.ss_family == AF_INET6
                   ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                   : reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

// What accept() says when the machine is short of something, which passes.
bool is_shortage(int error) {
  return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM;
}

bool is_lasting(int error) {
  return error == EBADF || error == EINVAL || error == ENOTSOCK || error == EOPNOTSUPP;
}

}  // namespace

Acceptor::Acceptor(std::string name, std::string address, Take take)
    : name_(std::move(name)),
      address_(std::move(address)),
      take_(std::move(take)),
      wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  if (!wake_.valid()) throw std::system_error(errno, std::system_category(), "eventfd");
}

proto::Expected<std::unique_ptr<Acceptor>> Acceptor::start(std::string name, std::string address,
                                                           std::uint16_t port, Take take) {
  std::unique_ptr<Acceptor> made(
      new Acceptor(std::move(name), std::move(address), std::move(take)));
  if (!made->bind(port))
    return proto::fail("cannot_listen", "Could not listen on " + made->address_ + ":" +
                                            std::to_string(port) +
                                            ": the address is in use or not ours.");
  made->thread_ = std::thread([self = made.get()] { self->loop(); });
  return made;
}

Acceptor::~Acceptor() {
  stop();
}

void Acceptor::stop() {
  stopping_ = true;
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t full_is_fine = ::write(wake_.get(), &one, sizeof one);
  if (!thread_.joinable()) return;
  thread_.join();
  listener_.reset();
}

bool Acceptor::bind(std::uint16_t port) {
  listener_.reset();
  listener_ = listen_on(address_, port);
  if (!listener_.valid()) return false;
  if (port_ == 0) port_ = port_of(listener_.get());  // bound again, it is the same: others read it
  return true;
}

void Acceptor::pause(int milliseconds) const {
  pollfd p{wake_.get(), POLLIN, 0};
  ::poll(&p, 1, milliseconds);
}

void Acceptor::loop() {
  constexpr int kRebindMs = 200;
  while (!stopping_) {
    std::array<pollfd, 2> fds{{{listener_.get(), POLLIN, 0}, {wake_.get(), POLLIN, 0}}};
    ::poll(fds.data(), fds.size(), -1);
    if (stopping_) return;
    if (fds[0].revents == 0 || accept_one()) continue;
    // The socket is gone: a service that can't be reached any more helps nobody.
    while (!stopping_ && !bind(port_)) pause(kRebindMs);
    if (stopping_) return;
    log_line(base::LogLevel::kWarn, "http.rebound", {{"server", name_}, {"port", port_}});
  }
}

bool Acceptor::accept_one() {
  constexpr int kShortageMs = 100;
  proto::Fd fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (fd.valid()) {
    const int yes = 1;
    ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    try {
      take_(std::move(fd));
    } catch (const std::bad_alloc&) {  // that connection is closed; the next may find memory
    }
    return true;
  }
  const int error = errno;
  if (is_lasting(error)) {
    log_line(base::LogLevel::kError, "http.listen",
             {{"server", name_}, {"what", std::strerror(error)}, {"then", "binding again"}});
    return false;
  }
  if (!is_shortage(error)) return true;  // an error of that connection
  log_line(base::LogLevel::kWarn, "http.accept",
           {{"server", name_}, {"what", std::strerror(error)}});
  pause(kShortageMs);
  return true;
}

}  // namespace kiln::http
