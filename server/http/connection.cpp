#include "server/http/connection.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "server/http/head.h"

namespace kiln::http {
namespace {

constexpr std::size_t kRead = std::size_t{64} * 1024;
constexpr std::string_view kHeadEnd = "\r\n\r\n";

}  // namespace

Connection::Connection(proto::Fd fd, const EdgeLimits& limits, Census::Place place)
    : fd_(std::move(fd)), limits_(limits), place_(std::move(place)) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (::getpeername(fd_.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0) return;
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address.ss_family == AF_INET) {
    const auto* v4 = reinterpret_cast<const sockaddr_in*>(&address);
    ::inet_ntop(AF_INET, &v4->sin_addr, text.data(), text.size());
    peer_port_ = ntohs(v4->sin_port);
  } else if (address.ss_family == AF_INET6) {
    const auto* v6 = reinterpret_cast<const sockaddr_in6*>(&address);
    ::inet_ntop(AF_INET6, &v6->sin6_addr, text.data(), text.size());
    peer_port_ = ntohs(v6->sin6_port);
  }
  peer_ = text.data();
}

ssize_t Connection::receive(char* out, std::size_t n) {
  for (;;) {
    const ssize_t got = ::recv(fd_.get(), out, n, 0);
    if (got >= 0 || errno != EINTR) return got;
  }
}

Connection::Fill Connection::fill() {
  buffer_.erase(0, at_);
  at_ = 0;
  for (;;) {
    const auto end = buffer_.find(kHeadEnd);
    if (end != std::string::npos && end + kHeadEnd.size() <= HeadLimits::kBytes) return Fill::kHead;
    if (buffer_.size() >= HeadLimits::kBytes) return Fill::kTooLarge;
    std::array<char, 4096> piece;
    const ssize_t got = receive(piece.data(), piece.size());
    if (got == 0) return Fill::kClosed;
    if (got < 0) return errno == EAGAIN || errno == EWOULDBLOCK ? Fill::kMore : Fill::kClosed;
    buffer_.append(piece.data(), static_cast<std::size_t>(got));
  }
}

std::string Connection::take_head() {
  const std::size_t end = buffer_.find(kHeadEnd) + kHeadEnd.size();
  at_ = end;
  return buffer_.substr(0, end);
}

void Connection::begin_exchange() {
  began_ = Clock::now();
  waited_ = {};
  read_ = written_ = 0;
}

bool Connection::wait(short events, std::chrono::milliseconds time) {
  const auto start = Clock::now(), until = start + time;
  const struct Count {
    Clock::time_point start;
    Clock::duration& waited;
    ~Count() { waited += Clock::now() - start; }
  } count{start, waited_};
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
    pollfd p{fd_.get(), events, 0};
    const int ready = ::poll(&p, 1, static_cast<int>(std::max<std::int64_t>(left.count(), 0)));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

bool Connection::too_slow(std::uint64_t bytes) const {
  const std::chrono::duration<double> time = Clock::now() - began_;
  return time > limits_.rate_grace && static_cast<double>(bytes) < limits_.min_rate * time.count();
}

ssize_t Connection::read(char* out, std::size_t n) {
  if (!has_bytes()) {
    buffer_.resize(kRead);
    at_ = 0;
    ssize_t got = -1;
    if (!too_slow(read_)) {
      got = receive(buffer_.data(), kRead);
      if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK) && wait(POLLIN, limits_.read_idle))
        got = receive(buffer_.data(), kRead);
    }
    buffer_.resize(static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got <= 0) return got;
    read_ += static_cast<std::uint64_t>(got);
  }
  const std::size_t take = std::min(n, buffer_.size() - at_);
  std::memcpy(out, buffer_.data() + at_, take);
  at_ += take;
  return static_cast<ssize_t>(take);
}

bool Connection::write(std::string_view bytes) {
  const auto start = Clock::now();
  std::uint64_t done = 0;
  while (!bytes.empty()) {
    const ssize_t sent = ::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(sent));
      written_ += static_cast<std::uint64_t>(sent);
      done += static_cast<std::uint64_t>(sent);
      continue;
    }
    if (errno == EINTR) continue;
    if (errno != EAGAIN && errno != EWOULDBLOCK) return false;
    const std::chrono::duration<double> time = Clock::now() - start;
    if (time > limits_.rate_grace && static_cast<double>(done) < limits_.min_rate * time.count())
      return false;
    if (!wait(POLLOUT, limits_.write_idle)) return false;
  }
  return true;
}

void Connection::write_at_once(std::string_view bytes) {
  const ssize_t sent = ::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  written_ += static_cast<std::uint64_t>(std::max<ssize_t>(sent, 0));
}

void Connection::shut_down_writing() {
  ::shutdown(fd_.get(), SHUT_WR);
}

bool Connection::discard() {
  std::array<char, std::size_t{16} * 1024> piece;
  for (int i = 0; i < 64; ++i) {
    const ssize_t got = receive(piece.data(), piece.size());
    if (got == 0) return false;
    if (got < 0) return errno == EAGAIN || errno == EWOULDBLOCK;
  }
  return true;
}

}  // namespace kiln::http
