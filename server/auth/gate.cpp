#include "server/auth/gate.h"

#include <netdb.h>
#include <netinet/in.h>

#include <memory>

namespace kiln::auth {
namespace {

// Returns what follows "Bearer "; nothing when the header is of another scheme.
std::optional<std::string_view> bearer(const http::RequestHead& head) {
  const std::string* header = head.header("authorization");
  if (!header) return std::nullopt;
  const auto blank = header->find(' ');
  if (blank == std::string::npos || !http::equal_ignoring_case(header->substr(0, blank), "bearer"))
    return std::nullopt;
  return http::trim_blanks(std::string_view(*header).substr(blank));
}

// A browser names the page that a request comes from; our own pages have the service's own name.
bool is_of_another_site(const http::RequestHead& head) {
  const std::string* origin = head.header("origin");
  const std::string* host = head.header("host");
  return origin && (!host || (*origin != "http://" + *host && *origin != "https://" + *host));
}

bool is_loopback(const sockaddr& address) {
  if (address.sa_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    return ntohl(v4.sin_addr.s_addr) >> 24 == 127;
  }
  return address.sa_family == AF_INET6 &&
         IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
}

}  // namespace

proto::Expected<base::Principal> Gate::admit(const http::RequestHead& head) const {
  if (!tokens_.required()) {
    if (!is_of_another_site(head)) return base::Principal::anonymous();
    return proto::fail("forbidden_origin", "Requests from web pages of other sites are refused.");
  }
  const auto secret = bearer(head);
  if (!secret)
    return proto::fail("unauthorized", "This service wants a token: Authorization: Bearer lk_...");
  const auto principal = tokens_.authenticate(*secret);
  if (!principal) return proto::fail("unauthorized", "The token is unknown, expired or revoked.");
  const bool reads = head.method == "GET" || head.method == "HEAD" || head.method == "OPTIONS";
  if (reads ? principal->read : principal->write) return *principal;
  return proto::fail("forbidden_scope",
                     std::string("The token lacks the scope ") + (reads ? "read." : "write."));
}

bool is_loopback(const std::string& address) {
  addrinfo* found = nullptr;
  if (::getaddrinfo(address.c_str(), nullptr, nullptr, &found) != 0) return false;
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(found, &::freeaddrinfo);
  for (const addrinfo* at = found; at != nullptr; at = at->ai_next)
    if (!is_loopback(*at->ai_addr)) return false;
  return found != nullptr;
}

}  // namespace kiln::auth
