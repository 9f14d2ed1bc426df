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

  /// "10.0.0.0/8, fd00::/8, 192.0.2.7": blanks and commas between; "" is the empty list.
  /// Errors: `invalid_config`.
  static proto::Expected<Networks> parse(std::string_view list);

  /// An address in numbers, without brackets; nothing when it is a name.
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

/// Whether an address belongs to the public internet: not this machine, a private, link-local,
/// shared, documentation, benchmark, multicast or reserved range, nor one of these behind IPv6
/// (mapped, NAT64, 6to4). Cloud metadata services are in them too.
bool is_public(const Networks::Address&);

/// Whether a webhook may go there: to public addresses, and to those that are allowed. Families
/// other than IPv4 and IPv6: never.
bool may_reach(const sockaddr&, const Networks& allowed);

}  // namespace kiln::webhooks
