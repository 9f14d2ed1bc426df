#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

#include "proto/files.h"
#include "server/http/concurrency_limiter.h"

namespace kiln::http {

/// The limits on how long a peer may take and how slow it may be.
struct EdgeLimits {
  std::chrono::milliseconds head_deadline{10'000};  ///< from the first byte (or accept) to the end
  std::chrono::milliseconds keep_alive{30'000};     ///< longest time between two requests
  std::chrono::milliseconds read_idle{15'000};      ///< longest time without a byte of the body
  std::chrono::milliseconds write_idle{
      30'000};  ///< longest time without room for a byte of the answer
  std::chrono::milliseconds rate_grace{10'000};  ///< after which min_rate holds
  std::chrono::milliseconds linger{2'000};       ///< time for the peer to take an early answer
  double min_rate = 4096;                        ///< bytes per second of a body, either way
  std::size_t connections = 0;                   ///< open at a time, streams too; 0: no limit
  std::size_t connections_per_peer = 0;          ///< limit for one address
  std::size_t waiting = 1024;                    ///< requests that wait for a thread
  std::size_t uploads_per_peer = 0;    ///< bodies that arrive, from one address; 0: no limit
  std::size_t uploads_per_tenant = 0;  ///< the same of one tenant
};

/// A non-blocking socket with what has arrived and is not used yet. Used by one thread at a time;
/// no function waits.
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  /// `permit` is what it takes of the open connections; null: none.
  Connection(proto::Fd, const EdgeLimits&, ConcurrencyLimiter::Permit permit = {});

  int fd() const { return fd_.get(); }
  proto::Fd release() { return std::move(fd_); }
  ConcurrencyLimiter::Permit release_permit() { return std::move(permit_); }
  const EdgeLimits& limits() const { return limits_; }
  const std::string& peer_address() const { return peer_; }

  enum class Fill { kMore, kHead, kTooLarge, kClosed };
  /// Takes what has arrived and returns whether a whole head is there.
  Fill fill();
  /// Cuts the head off what has arrived. It is called after Fill::kHead.
  std::string take_head();

  /// Returns what has arrived and is not used yet.
  std::string_view buffered() const { return std::string_view(buffer_).substr(at_); }
  bool has_bytes() const { return at_ < buffer_.size(); }
  void consume(std::size_t n);      ///< drops the first n of these bytes
  void put_back(std::string_view);  ///< bytes that were received and belong to the next request

  enum class Got { kBytes, kNothing, kClosed };
  /// Receives up to n bytes, past the buffer, which has to be empty. `got` is set with kBytes.
  Got receive(char* out, std::size_t n, std::size_t& got);
  /// Sends what the socket takes of the bytes. Returns their number, or -1 when the connection is
  /// broken.
  ssize_t send(std::string_view bytes);
  /// Sends the same way up to n > 0 bytes of a file. Returns -1 also when the file ends before.
  ssize_t send_file(int file, std::uint64_t offset, std::size_t n);
  /// Sends what the socket takes at once, for a last answer.
  void write_at_once(std::string_view bytes) { (void)send(bytes); }
  void shut_down_writing();
  /// Throws away what has arrived. Returns false when the peer is done.
  bool discard();

  std::uint64_t bytes_written() const { return written_; }
  Clock::time_point deadline;  ///< end of the wait that the connection is in

 private:
  const EdgeLimits& limits_;
  proto::Fd fd_;
  ConcurrencyLimiter::Permit permit_;
  std::string peer_;
  std::string buffer_;
  std::size_t at_ = 0;
  std::uint64_t written_ = 0;
};

/// Measures how fast the bytes of one body move, in or out, against the least rate.
class TransferClock {
 public:
  using Clock = Connection::Clock;

  void begin() { *this = TransferClock(), began_ = Clock::now(); }
  void moved(std::size_t bytes) { bytes_ += bytes; }
  /// Returns whether so few bytes have moved that the transfer has to end.
  bool too_slow(const EdgeLimits&) const;
  /// Returns when a wait for the next byte has to end: at `idle` from now, or earlier when the
  /// transfer becomes too slow.
  Clock::time_point deadline(const EdgeLimits&, std::chrono::milliseconds idle) const;

 private:
  Clock::time_point began_{};
  std::uint64_t bytes_ = 0;
};

}  // namespace kiln::http
