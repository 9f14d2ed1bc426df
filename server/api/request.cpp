#include "server/api/request.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"
#include "server/http/conditional.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

constexpr std::size_t kMaxIdempotencyKey = 255;

std::optional<std::uint64_t> whole_number(const std::string& text) {
  std::uint64_t value = 0;
  const char* const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, value);
  if (text.empty() || parsed.ec != std::errc() || parsed.ptr != end) return std::nullopt;
  return value;
}

proto::Expected<std::optional<nlohmann::json>> parse_object(const std::string& text) {
  if (text.empty()) return std::nullopt;
  auto document = proto::parse_json(text, "request");
  if (!document) return proto::Unexpected(document.error());
  if (!document->is_object())
    return proto::fail("invalid_request", "The body has to be a JSON object.", "request", "");
  return std::move(*document);
}

}  // namespace

proto::Expected<std::optional<std::uint64_t>> query_number(const http::Request& request,
                                                           const char* name, std::uint64_t max) {
  const std::string* text = request.head.query_value(name);
  if (!text) return std::nullopt;
  if (const auto value = whole_number(*text); value && *value <= max) return value;
  return proto::fail("bad_request",
                     std::string("The query parameter `") + name +
                         "` has to be a whole number from 0 to " + std::to_string(max) + ".",
                     "request", std::string("/query/") + name);
}

proto::Expected<void> only_query(const http::Request& request,
                                 std::initializer_list<std::string_view> names) {
  for (const auto& [name, value] : request.head.query) {
    if (std::ranges::find(names, name) != names.end()) continue;
    std::string known;
    for (const std::string_view one : names)
      known.append(known.empty() ? "`" : ", `").append(one).append("`");
    return proto::fail("bad_request",
                       "There is no query parameter `" + name + "` here; there are " + known + ".",
                       "request", "/query/" + name);
  }
  return {};
}

proto::Expected<std::optional<std::uint64_t>> header_number(const http::Request& request,
                                                            const char* name) {
  const std::string* text = request.head.header(name);
  if (!text) return std::nullopt;
  if (const auto value = whole_number(*text)) return value;
  return proto::fail("bad_request",
                     std::string("The header ") + name + " has to be a whole number.", "request",
                     std::string("/headers/") + name);
}

proto::Expected<std::string> idempotency_key(const http::Request& request) {
  const std::string* key = request.head.header("idempotency-key");
  if (!key) return std::string();
  const bool fits =
      !key->empty() && key->size() <= kMaxIdempotencyKey &&
      std::all_of(key->begin(), key->end(), [](char c) { return c > ' ' && c <= '~'; });
  if (fits) return *key;
  return proto::fail("bad_request",
                     "The Idempotency-Key has to be 1 to 255 visible ASCII characters.", "request",
                     "/headers/idempotency-key");
}

http::Response receive_json_object(http::Request& request, const Intake& intake,
                                   JsonAnswer answer) {
  return receive_text(
      request, intake,
      [answer = std::move(answer)](http::Request& again, proto::Expected<std::string> text) {
        if (!text) return problem(text.error(), again);
        const auto document = parse_object(*text);
        return document ? answer(again, *document) : problem(document.error(), again);
      });
}

http::Response no_content() {
  http::Response response;
  response.status = 204;
  return response;
}

http::Response not_modified(const std::string& etag) {
  http::Response response;
  response.status = 304;
  return response.header("ETag", etag);
}

bool client_has(const http::Request& request, const std::string& etag) {
  const std::string* known = request.head.header("if-none-match");
  return known && http::matches_etag(*known, etag);
}

}  // namespace kiln::api
