#include "server/http/census.h"

#include <netinet/in.h>
#include <sys/socket.h>

namespace kiln::http {

std::string peer_key(int socket) {
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

Census::Census(std::size_t all, std::size_t per_peer) : max_all_(all), max_per_peer_(per_peer) {}

std::size_t Census::open() const {
  const std::lock_guard lock(book_->mutex);
  return book_->all;
}

Census::Entry Census::enter(int socket) {
  const std::string key = peer_key(socket);
  const std::lock_guard lock(book_->mutex);
  if (max_all_ > 0 && book_->all >= max_all_) return {nullptr, Refusal::kFull};
  std::size_t& count = book_->by[key];
  if (max_per_peer_ > 0 && count >= max_per_peer_) return {nullptr, Refusal::kPeerFull};
  const auto leave = [book = book_, key](const void*) {
    const std::lock_guard again(book->mutex);
    --book->all;
    const auto found = book->by.find(key);
    if (--found->second == 0) book->by.erase(found);
  };
  ++count;
  ++book_->all;
  return {Place(this, leave), Refusal::kNone};
}

}  // namespace kiln::http
