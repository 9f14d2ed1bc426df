#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "proto/expected.h"
#include "server/http/message.h"

namespace kiln::http {

/// Returns a problem as application/problem+json. Status, title and Retry-After follow from the
/// error's code.
Response problem(const proto::Error&, const std::string& request_id,
                 const std::string& instance = {});
inline Response problem(const proto::Error& error, const Request& request) {
  return problem(error, request.id, request.head.path);
}

Response json_response(int status, const nlohmann::json&);

/// Returns a whole answer as bytes, for what is refused before there is a request. It says
/// Connection: close.
std::string raw_problem(const proto::Error&, const std::string& request_id);

}  // namespace kiln::http
