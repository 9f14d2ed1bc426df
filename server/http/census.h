#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace kiln::http {

/// Counts open connections, in all and by peer, so that nobody takes everyone's places. A peer is
/// an IPv4 address or an IPv6 network of 64 bits, which is what one customer gets. Thread-safe.
class Census {
 public:
  /// 0: no limit.
  Census(std::size_t all, std::size_t per_peer);

  enum class Refusal { kNone, kFull, kPeerFull };
  /// A place that is free again when the last copy goes; it may outlive the census.
  using Place = std::shared_ptr<const void>;
  struct Entry {
    Place place;  ///< null when refused
    Refusal refusal = Refusal::kNone;
  };
  /// A connection of the peer at the other end of this socket.
  Entry enter(int socket);
  std::size_t open() const;

 private:
  struct Book {
    mutable std::mutex mutex;
    std::size_t all = 0;                    ///< guarded by mutex
    std::map<std::string, std::size_t> by;  ///< guarded by mutex
  };
  std::shared_ptr<Book> book_ = std::make_shared<Book>();
  std::size_t max_all_, max_per_peer_;
};

/// Names the peer of a socket as Census counts it; "" when it has none.
std::string peer_key(int socket);

}  // namespace kiln::http
