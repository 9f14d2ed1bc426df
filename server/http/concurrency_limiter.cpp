#include "server/http/concurrency_limiter.h"

#include <netinet/in.h>
#include <sys/socket.h>

namespace kiln::http {

std::string peer_network(int socket) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (::getpeername(socket, reinterpret_cast<sockaddr*>(&address), &size) != 0) return {};
  if (address.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    return {reinterpret_cast<const char*>(&v4.sin_addr), 4};
  }
  if (address.ss_family != AF_INET6) return {};
  const auto& v6 = reinterpret_cast<const sockaddr_in6&>(address);
  const char* bytes = reinterpret_cast<const char*>(&v6.sin6_addr);
  if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) return {bytes + 12, 4};
  return {bytes, 8};
}

ConcurrencyLimiter::ConcurrencyLimiter(std::size_t all, std::size_t per_key)
    : max_all_(all), max_per_key_(per_key) {}

std::size_t ConcurrencyLimiter::open() const {
  const std::lock_guard lock(counts_->mutex);
  return counts_->all;
}

ConcurrencyLimiter::Entry ConcurrencyLimiter::enter(const std::string& key) {
  const std::lock_guard lock(counts_->mutex);
  if (max_all_ > 0 && counts_->all >= max_all_) return {nullptr, Refusal::kFull};
  const auto found = counts_->by.find(key);
  if (max_per_key_ > 0 && found != counts_->by.end() && found->second >= max_per_key_)
    return {nullptr, Refusal::kKeyFull};
  const auto leave = [counts = counts_, key](const void*) {
    const std::lock_guard again(counts->mutex);
    --counts->all;
    const auto at = counts->by.find(key);
    if (--at->second == 0) counts->by.erase(at);
  };
  ++counts_->by[key];
  ++counts_->all;
  return {Permit(this, leave), Refusal::kNone};
}

}  // namespace kiln::http
