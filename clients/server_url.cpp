#include "clients/server_url.h"

#include <algorithm>
#include <charconv>

namespace kiln::clients {
namespace {

bool is_host(std::string_view host) {
  return !host.empty() && std::all_of(host.begin(), host.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '.' || c == '-' || c == '_' || c == ':' || c == '[' ||
           c == ']';
  });
}

bool is_port(std::string_view text) {
  unsigned port = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), port);
  return error == std::errc{} && end == text.data() + text.size() && port >= 1 && port <= 65535;
}

}  // namespace

proto::Expected<ServerUrl> parse_server_url(std::string_view text) {
  const auto bad = [&](const std::string& why) {
    return proto::fail("bad_request", "The server URL \"" + std::string(text.substr(0, 100)) +
                                          "\" " + why + "; expected something like " +
                                          kDefaultServer);
  };
  std::string_view rest = text;
  std::string scheme = "http";
  if (const auto mark = rest.find("://"); mark != std::string_view::npos) {
    scheme = rest.substr(0, mark);
    rest.remove_prefix(mark + 3);
  }
  if (scheme != "http" && scheme != "https") return bad("is neither http nor https");
  const auto slash = rest.find('/');
  const auto authority = rest.substr(0, slash);
  std::string base(slash == std::string_view::npos ? std::string_view{} : rest.substr(slash));
  while (!base.empty() && base.back() == '/') base.pop_back();
  if (base.find_first_of("?# \r\n\t") != std::string::npos)
    return bad("has a query, a fragment or a space");

  const auto bracket = authority.rfind(']');
  const auto colon = authority.rfind(':');
  const bool has_port =
      colon != std::string_view::npos && (bracket == std::string_view::npos || colon > bracket);
  if (!is_host(authority.substr(0, has_port ? colon : authority.size())))
    return bad("has no usable host name");
  if (has_port && !is_port(authority.substr(colon + 1))) return bad("has no usable port");
  return ServerUrl{scheme + "://" + std::string(authority), base};
}

}  // namespace kiln::clients
