#include "server/auth/rate_limiter.h"

#include <algorithm>
#include <cmath>

namespace kiln::auth {

RateLimiter::State RateLimiter::take(const std::string& key, Clock::time_point now) {
  return state(key, now, true);
}

RateLimiter::State RateLimiter::look(const std::string& key, Clock::time_point now) {
  return state(key, now, false);
}

RateLimiter::State RateLimiter::state(const std::string& key, Clock::time_point now, bool count) {
  if (per_minute_ == 0) return {};
  constexpr double kMinute = 60;
  const double capacity = per_minute_;
  const auto seconds = [&](double requests) {
    constexpr double kRounding = 1e-6;  // rounding error of sums of fractions
    return static_cast<std::uint32_t>(
        std::ceil(std::max(0.0, requests * kMinute / capacity - kRounding)));
  };
  const std::lock_guard lock(mutex_);
  auto& bucket = buckets_.try_emplace(key, Bucket{capacity, now}).first->second;
  const double passed = std::max(0.0, std::chrono::duration<double>(now - bucket.filled).count());
  bucket.requests = std::min(capacity, bucket.requests + passed * capacity / kMinute);
  bucket.filled = std::max(now, bucket.filled);
  State out;
  out.limited = true;
  out.limit = per_minute_;
  out.allowed = bucket.requests >= 1;
  if (out.allowed && count) bucket.requests -= 1;
  out.remaining = static_cast<std::uint32_t>(bucket.requests);
  out.reset = seconds(capacity - bucket.requests);
  out.retry = out.allowed ? 0 : std::max(1u, seconds(1 - bucket.requests));
  return out;
}

}  // namespace kiln::auth
