#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/http/message.h"

namespace kiln::http {

/// Finds the handler of a request. Patterns are literal segments and `{}` for one that is handed to
/// the handler; no regular expressions. A GET route answers HEAD too.
class Router {
 public:
  void add(std::string method, std::string_view pattern, Handler);
  /// Finds the handler. The router itself answers 404, 405 with Allow, and OPTIONS.
  Response route(Request&) const;

 private:
  struct Route {
    std::string method, pattern;
    std::vector<std::string> segments;
    Handler handler;
  };
  std::vector<Route> routes_;
};

}  // namespace kiln::http
