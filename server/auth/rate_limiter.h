#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace kiln::auth {

/// So many requests a minute for each key, all of them at once if it likes: a bucket that holds a
/// minute's worth and fills evenly. Thread-safe. Keys are tenants and tokens, which are few.
class RateLimiter {
 public:
  using Clock = std::chrono::steady_clock;

  explicit RateLimiter(std::uint32_t per_minute) : per_minute_(per_minute) {}  ///< 0: no limit

  struct State {
    bool limited = false;         ///< whether there is a limit at all
    bool allowed = true;          ///< this request
    std::uint32_t limit = 0;      ///< requests a minute
    std::uint32_t remaining = 0;  ///< requests that would be allowed now
    std::uint32_t reset = 0;      ///< seconds until `remaining` is `limit`, rounded up
    std::uint32_t retry = 0;      ///< seconds until one is allowed, rounded up
  };
  /// Counts a request, unless it is refused.
  State take(const std::string& key, Clock::time_point now = Clock::now());
  /// Returns the same without counting the request: `remaining` is what there is before it.
  State look(const std::string& key, Clock::time_point now = Clock::now());

 private:
  State state(const std::string& key, Clock::time_point now, bool count);
  struct Bucket {
    double requests = 0;
    Clock::time_point filled;
  };
  const std::uint32_t per_minute_;
  std::mutex mutex_;
  std::map<std::string, Bucket> buckets_;  ///< guarded by mutex_
};

}  // namespace kiln::auth
