#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

#include "proto/files.h"
#include "server/http/census.h"

namespace kiln::http {

/// How long and how slow a peer may be.
struct EdgeLimits {
  std::chrono::milliseconds head_deadline{10'000};  ///< from the first byte (or accept) to the end
  std::chrono::milliseconds keep_alive{30'000};     ///< between two requests
  std::chrono::milliseconds read_idle{15'000};      ///< without a byte of the body
  std::chrono::milliseconds write_idle{30'000};     ///< without room for a byte of the answer
  std::chrono::milliseconds rate_grace{10'000};     ///< after which min_rate holds
  std::chrono::milliseconds linger{2'000};          ///< for the peer to take an early answer
  double min_rate = 4096;                           ///< bytes per second of a body, either way
  std::size_t connections = 0;                      ///< open at a time, streams too; 0: no limit
  std::size_t connections_per_peer = 0;             ///< of these, from one address
  std::size_t waiting = 1024;                       ///< requests that wait for a thread
};

/// A non-blocking socket with a buffer. Used by one thread at a time.
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  /// `place` is what it takes of everyone's; null: none.
  Connection(proto::Fd, const EdgeLimits&, Census::Place place = {});

  int fd() const { return fd_.get(); }
  proto::Fd release() { return std::move(fd_); }
  Census::Place release_place() { return std::move(place_); }
  const std::string& peer_address() const { return peer_; }
  int peer_port() const { return peer_port_; }

  enum class Fill { kMore, kHead, kTooLarge, kClosed };
  /// Takes what has arrived, without waiting, and says whether a whole head is there.
  Fill fill();
  bool has_bytes() const { return at_ < buffer_.size(); }
  /// Cuts the head off the buffer; after Fill::kHead.
  std::string take_head();

  void begin_exchange();  ///< the clocks of a new request start
  /// Waits for bytes of the body: > 0, or <= 0 when closed, idle or below the rate.
  ssize_t read(char* out, std::size_t n);
  /// Writes all, waiting for room; false when closed, idle or below the rate.
  bool write(std::string_view bytes);
  /// Writes what the socket takes at once: for last words.
  void write_at_once(std::string_view bytes);
  void shut_down_writing();
  /// Throws away what has arrived. False when the peer is done.
  bool discard();

  std::uint64_t bytes_written() const { return written_; }
  /// Time of this exchange that was spent waiting for the peer.
  Clock::duration waited() const { return waited_; }
  Clock::time_point deadline;  ///< of the wait that the connection is in

 private:
  bool wait(short events, std::chrono::milliseconds);
  bool too_slow(std::uint64_t bytes) const;
  ssize_t receive(char* out, std::size_t n);

  proto::Fd fd_;
  const EdgeLimits& limits_;
  Census::Place place_;
  std::string peer_;
  int peer_port_ = 0;
  std::string buffer_;
  std::size_t at_ = 0;
  Clock::time_point began_;
  Clock::duration waited_{};
  std::uint64_t read_ = 0, written_ = 0;
};

}  // namespace kiln::http
