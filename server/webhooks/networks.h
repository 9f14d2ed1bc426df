#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"

struct sockaddr;

namespace kiln::webhooks {

/// A list of address ranges: IPv4 and IPv6, the former as ::ffff:a.b.c.d.
class Networks {
 public:
  using Address = std::array<unsigned char, 16>;

  /// Parses "10.0.0.0/8, fd00::/8, 192.0.2.7", with blanks and commas between; "" is the empty
  /// list.
  /// Errors: `invalid_config`.
  static proto::Expected<Networks> parse(std::string_view list);

  /// Returns an address in numbers, without brackets; nothing when it is a name.
  static std::optional<Address> address(const std::string& text);

  bool contains(const Address&) const;
  bool empty() const { return ranges_.empty(); }

 private:
  struct Range {
    Address base{};
    unsigned bits = 0;
  };
  std::vector<Range> ranges_;
};

/// Returns whether an address belongs to the public internet: not this machine, a private,
/// link-local, shared, documentation, benchmark, multicast or reserved range, nor one of these
/// behind IPv6 (mapped, NAT64, 6to4). Those ranges include cloud metadata services.
bool is_public(const Networks::Address&);

/// Returns whether a webhook may go there: to public addresses, and to those that are allowed,
/// never to families other than IPv4 and IPv6.
bool may_reach(const sockaddr&, const Networks& allowed);

}  // namespace kiln::webhooks
