#include "server/webhooks/networks.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <optional>
#include <string>

namespace kiln::webhooks {
namespace {

using Address = Networks::Address;

Address mapped(const unsigned char* v4) {
  Address out{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  std::copy_n(v4, 4, out.begin() + 12);
  return out;
}

struct Parsed {
  Address address{};
  bool v4 = false;
};

std::optional<Parsed> parse_address(const std::string& text) {
  Parsed out;
  std::array<unsigned char, 4> v4{};
  out.v4 = ::inet_pton(AF_INET, text.c_str(), v4.data()) == 1;
  if (out.v4) {
    out.address = mapped(v4.data());
    return out;
  }
  if (::inet_pton(AF_INET6, text.c_str(), out.address.data()) == 1) return out;
  return std::nullopt;
}

// IANA's special-purpose registries; what is allocated for a use within a network or for none.
const Networks& special() {
  static const Networks list =
      Networks::parse(
          "0.0.0.0/8 10.0.0.0/8 100.64.0.0/10 127.0.0.0/8 169.254.0.0/16 172.16.0.0/12 192.0.0.0/24"
          " 192.0.2.0/24 192.88.99.0/24 192.168.0.0/16 198.18.0.0/15 198.51.100.0/24"
          " 203.0.113.0/24 224.0.0.0/3"
          " ::/96 64:ff9b:1::/48 100::/64 2001::/23 2001:db8::/32 3fff::/20 5f00::/16 fc00::/7"
          " fe80::/9 ff00::/8")
          .value();
  return list;
}

bool begins_with(const Address& address, std::initializer_list<unsigned char> bytes) {
  return std::equal(bytes.begin(), bytes.end(), address.begin());
}

}  // namespace

std::optional<Address> Networks::address(const std::string& text) {
  const auto parsed = parse_address(text);
  if (!parsed) return std::nullopt;
  return parsed->address;
}

proto::Expected<Networks> Networks::parse(std::string_view list) {
  Networks out;
  while (true) {
    list.remove_prefix(std::min(list.find_first_not_of(" ,"), list.size()));
    if (list.empty()) return out;
    const std::string_view text = list.substr(0, list.find_first_of(" ,"));
    list.remove_prefix(text.size());
    const auto slash = text.find('/');
    const auto address = parse_address(std::string(text.substr(0, slash)));
    const unsigned most = address && address->v4 ? 32 : 128;
    unsigned bits = most;
    bool fits = address.has_value();
    if (slash != std::string_view::npos) {
      const std::string_view digits = text.substr(slash + 1);
      const auto end = digits.data() + digits.size();
      const auto parsed = std::from_chars(digits.data(), end, bits);
      fits = fits && parsed.ec == std::errc() && parsed.ptr == end && bits <= most;
    }
    if (!fits)
      return proto::fail(
          "invalid_config",
          "\"" + std::string(text) + "\" is no address range like 10.0.0.0/8 or fd00::/8");
    out.ranges_.push_back({address->address, bits + 128 - most});
  }
}

bool Networks::contains(const Address& address) const {
  return std::any_of(ranges_.begin(), ranges_.end(), [&](const Range& range) {
    const unsigned whole = range.bits / 8, rest = range.bits % 8;
    if (!std::equal(address.begin(), address.begin() + whole, range.base.begin())) return false;
    if (rest == 0) return true;
    const auto mask = static_cast<unsigned char>(0xffu << (8 - rest));
    return ((address[whole] ^ range.base[whole]) & mask) == 0;
  });
}

bool is_public(const Address& address) {
  if (special().contains(address)) return false;
  // IPv4 addresses that a gateway takes out of an IPv6 one.
  if (begins_with(address, {0, 0x64, 0xff, 0x9b, 0, 0, 0, 0, 0, 0, 0, 0}))
    return is_public(mapped(address.data() + 12));
  if (begins_with(address, {0x20, 0x02})) return is_public(mapped(address.data() + 2));
  return true;
}

bool may_reach(const sockaddr& address, const Networks& allowed) {
  Address bytes{};
  if (address.sa_family == AF_INET) {
    sockaddr_in v4{};
    std::memcpy(&v4, &address, sizeof v4);
    std::array<unsigned char, 4> four{};
    std::memcpy(four.data(), &v4.sin_addr, four.size());
    bytes = mapped(four.data());
  } else if (address.sa_family == AF_INET6) {
    sockaddr_in6 v6{};
    std::memcpy(&v6, &address, sizeof v6);
    std::memcpy(bytes.data(), &v6.sin6_addr, bytes.size());
  } else {
    return false;
  }
  return is_public(bytes) || allowed.contains(bytes);
}

}  // namespace kiln::webhooks
