#include "server/http/problem.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/problems.h"

namespace kiln::http {

Response problem(const proto::Error& error, const std::string& request_id,
                 const std::string& instance) {
  Response response;
  response.status = proto::problem_kind(error.code).status;
  response.content_type = "application/problem+json";
  response.body =
      proto::to_text(proto::problem_json(error, response.status, request_id, instance), 2) + "\n";
  response.header("Cache-Control", "no-store");
  if (response.status == 401) response.header("WWW-Authenticate", "Bearer realm=\"lightkiln\"");
  if (response.status == 503 || response.status == 429) response.header("Retry-After", "5");
  if (response.status == 425) response.header("Retry-After", "1");
  return response;
}

Response json_response(int status, const nlohmann::json& document) {
  Response response;
  response.status = status;
  response.content_type = "application/json";
  response.body = proto::to_text(document) + "\n";
  response.header("Cache-Control", "no-store");
  return response;
}

std::string raw_problem(const proto::Error& error, const std::string& request_id) {
  const Response response = problem(error, request_id);
  std::string text = "HTTP/1.1 " + std::to_string(response.status) + " " +
                     std::string(proto::problem_kind(error.code).title) + "\r\n";
  for (const auto& [name, value] : response.headers)
    text.append(name).append(": ").append(value).append("\r\n");
  text += "X-Request-Id: " + request_id + "\r\nContent-Type: " + response.content_type +
          "\r\nContent-Length: " + std::to_string(response.body.size()) +
          "\r\nConnection: close\r\n\r\n";
  return text + response.body;
}

}  // namespace kiln::http
