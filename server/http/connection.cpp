#include "server/http/connection.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/sendfile.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "server/http/head.h"

namespace kiln::http {
namespace {

constexpr std::string_view kHeadEnd = "\r\n\r\n";

bool would_block(int error) {
  return error == EAGAIN || error == EWOULDBLOCK;
}

/// Calls the system until no signal interrupts it.
template <class Call>
ssize_t uninterrupted(const Call& call) {
  for (;;) {
    const ssize_t result = call();
    if (result >= 0 || errno != EINTR) return result;
  }
}

std::string name_of_peer(int fd) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (::getpeername(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) return {};
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address.ss_family == AF_INET)
    ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in&>(address).sin_addr, text.data(),
                text.size());
  else if (address.ss_family == AF_INET6)
    ::inet_ntop(AF_INET6, &reinterpret_cast<const sockaddr_in6&>(address).sin6_addr, text.data(),
                text.size());
  return text.data();
}

}  // namespace

Connection::Connection(proto::Fd fd, const EdgeLimits& limits, ConcurrencyLimiter::Permit permit)
    : limits_(limits),
      fd_(std::move(fd)),
      permit_(std::move(permit)),
      peer_(name_of_peer(fd_.get())) {}

Connection::Fill Connection::fill() {
  buffer_.erase(0, at_);
  at_ = 0;
  for (;;) {
    const auto end = buffer_.find(kHeadEnd);
    if (end != std::string::npos && end + kHeadEnd.size() <= HeadLimits::kBytes) return Fill::kHead;
    if (buffer_.size() >= HeadLimits::kBytes) return Fill::kTooLarge;
    std::array<char, 4096> piece;
    std::size_t got = 0;
    const Got what = receive(piece.data(), piece.size(), got);
    if (what == Got::kClosed) return Fill::kClosed;
    if (what == Got::kNothing) return Fill::kMore;
    buffer_.append(piece.data(), got);
  }
}

std::string Connection::take_head() {
  const std::size_t end = buffer_.find(kHeadEnd) + kHeadEnd.size();
  std::string head = buffer_.substr(0, end);
  consume(end);
  return head;
}

// An empty buffer keeps no memory: thousands of connections have one.
void Connection::consume(std::size_t n) {
  at_ += n;
  if (has_bytes()) return;
  std::string().swap(buffer_);
  at_ = 0;
}

void Connection::put_back(std::string_view bytes) {
  buffer_.assign(bytes);
  at_ = 0;
}

Connection::Got Connection::receive(char* out, std::size_t n, std::size_t& got) {
  const ssize_t size = uninterrupted([&] { return ::recv(fd_.get(), out, n, 0); });
  if (size < 0) return would_block(errno) ? Got::kNothing : Got::kClosed;
  got = static_cast<std::size_t>(size);
  return got > 0 ? Got::kBytes : Got::kClosed;
}

ssize_t Connection::send(std::string_view bytes) {
  const ssize_t sent = uninterrupted(
      [&] { return ::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT); });
  if (sent < 0) return would_block(errno) ? 0 : -1;
  written_ += static_cast<std::uint64_t>(sent);
  return sent;
}

ssize_t Connection::send_file(int file, std::uint64_t offset, std::size_t n) {
  auto at = static_cast<off_t>(offset);
  const ssize_t sent = uninterrupted([&] { return ::sendfile(fd_.get(), file, &at, n); });
  if (sent < 0) return would_block(errno) ? 0 : -1;
  if (sent == 0) return -1;
  written_ += static_cast<std::uint64_t>(sent);
  return sent;
}

void Connection::shut_down_writing() {
  ::shutdown(fd_.get(), SHUT_WR);
}

bool Connection::discard() {
  std::array<char, std::size_t{16} * 1024> piece;
  for (int i = 0; i < 64; ++i) {
    std::size_t got = 0;
    const Got what = receive(piece.data(), piece.size(), got);
    if (what != Got::kBytes) return what == Got::kNothing;
  }
  return true;
}

bool TransferClock::too_slow(const EdgeLimits& limits) const {
  const std::chrono::duration<double> time = Clock::now() - began_;
  return time > limits.rate_grace && static_cast<double>(bytes_) < limits.min_rate * time.count();
}

TransferClock::Clock::time_point TransferClock::deadline(const EdgeLimits& limits,
                                                         std::chrono::milliseconds idle) const {
  if (!(limits.min_rate > 0)) return Clock::now() + idle;
  const std::chrono::duration<double> enough(static_cast<double>(bytes_) / limits.min_rate);
  const auto too_slow =
      began_ + std::max<Clock::duration>(limits.rate_grace,
                                         std::chrono::duration_cast<Clock::duration>(enough));
  return std::min(Clock::now() + idle, too_slow);
}

}  // namespace kiln::http
