#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace kiln::http {

/// Limits how many of something (connections, uploads) are open at a time, in all and of one key,
/// so that no key takes every share. Thread-safe.
class ConcurrencyLimiter {
 public:
  /// A limit of 0 means that there is none.
  ConcurrencyLimiter(std::size_t all, std::size_t per_key);

  enum class Refusal { kNone, kFull, kKeyFull };
  /// Counts as one until the last copy goes; it may outlive the limiter.
  using Permit = std::shared_ptr<const void>;
  struct Entry {
    Permit permit;  ///< null when refused
    Refusal refusal = Refusal::kNone;
  };
  Entry enter(const std::string& key);
  std::size_t open() const;

 private:
  struct Counts {
    mutable std::mutex mutex;
    std::size_t all = 0;                    ///< guarded by mutex
    std::map<std::string, std::size_t> by;  ///< guarded by mutex
  };
  const std::shared_ptr<Counts> counts_ = std::make_shared<Counts>();
  const std::size_t max_all_, max_per_key_;
};

/// Names the network of a socket's peer, which counts as one client: an IPv4 address, or the 64
/// bits of an IPv6 address that one customer gets. "" when it has none.
std::string peer_network(int socket);

}  // namespace kiln::http
