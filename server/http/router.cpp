#include "server/http/router.h"

#include <optional>
#include <set>

#include "server/http/problem.h"

namespace kiln::http {
namespace {

std::vector<std::string> split(std::string_view path) {
  std::vector<std::string> segments;
  while (!path.empty()) {
    path.remove_prefix(1);  // the slash
    const auto end = std::min(path.find('/'), path.size());
    segments.emplace_back(path.substr(0, end));
    path.remove_prefix(end);
  }
  return segments;
}

// `{}` matches one segment, or the rest of it after a literal beginning ("sha256:{}").
std::optional<std::vector<std::string>> match(const std::vector<std::string>& pattern,
                                              const std::vector<std::string>& path) {
  if (pattern.size() != path.size()) return std::nullopt;
  std::vector<std::string> parameters;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    if (!pattern[i].ends_with("{}")) {
      if (pattern[i] != path[i]) return std::nullopt;
      continue;
    }
    const std::string_view beginning(pattern[i].data(), pattern[i].size() - 2);
    if (!path[i].starts_with(beginning) || path[i].size() == beginning.size()) return std::nullopt;
    parameters.push_back(path[i].substr(beginning.size()));
  }
  return parameters;
}

}  // namespace

void Router::add(std::string method, std::string_view pattern, Handler handler) {
  routes_.push_back({std::move(method), std::string(pattern), split(pattern), std::move(handler)});
}

Response Router::route(Request& request) const {
  const std::string& method = request.head.method;
  const auto path = split(request.head.path);
  std::set<std::string> allowed;
  for (const auto& route : routes_) {
    auto parameters = match(route.segments, path);
    if (!parameters) continue;
    allowed.insert(route.method);
    request.route = route.pattern;
    if (route.method == "GET") allowed.insert("HEAD");
    if (route.method != method && !(route.method == "GET" && method == "HEAD")) continue;
    request.parameters = std::move(*parameters);
    return route.handler(request);
  }
  if (allowed.empty())
    return problem({"not_found", "There is nothing at " + request.head.path + ".", {}}, request);
  allowed.insert("OPTIONS");
  std::string allow;
  for (const auto& name : allowed) allow += (allow.empty() ? "" : ", ") + name;
  if (method == "OPTIONS") {
    Response response;
    response.status = 204;
    return response.header("Allow", allow);
  }
  const proto::Error error{
      "method_not_allowed", "This resource knows " + allow + ", not " + method + ".", {}};
  return problem(error, request).header("Allow", allow);
}

}  // namespace kiln::http
