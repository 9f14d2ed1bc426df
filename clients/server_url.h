#pragma once

#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::clients {

inline constexpr const char* kDefaultServer = "http://127.0.0.1:8080";

/// The address of a service. "http://host:8080/prefix" has origin "http://host:8080" and base
/// "/prefix"; the base never ends in '/'.
struct ServerUrl {
  std::string origin, base;

  std::string text() const { return origin + base; }
};

/// Parses a URL. "host:8080" is taken as http. Errors: `bad_request`, with what is wrong with the
/// URL.
proto::Expected<ServerUrl> parse_server_url(std::string_view);

}  // namespace kiln::clients
