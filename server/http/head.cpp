#include "server/http/head.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "proto/text_codes.h"

namespace kiln::http {
namespace {

using proto::fail;

constexpr std::array<std::string_view, 7> kMethods{"GET",   "HEAD",   "POST",   "PUT",
                                                   "PATCH", "DELETE", "OPTIONS"};

bool is_token_char(char c) {
  if ((c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z')) return true;
  return std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
}

bool is_token(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), is_token_char);
}

bool is_control(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte < 0x20 || byte == 0x7f;
}

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c;
}

proto::Unexpected bad(const char* what) {
  return proto::fail("bad_request", what);
}

// Cuts the next line off `rest`; nothing when it does not end with CRLF.
std::optional<std::string_view> take_line(std::string_view& rest) {
  const auto end = rest.find('\n');
  if (end == std::string_view::npos || end == 0 || rest[end - 1] != '\r') return std::nullopt;
  const auto line = rest.substr(0, end - 1);
  rest.remove_prefix(end + 1);
  if (line.find('\r') != std::string_view::npos) return std::nullopt;
  return line;
}

proto::Expected<void> parse_query(std::string_view query, RequestHead& head) {
  while (!query.empty()) {
    const auto end = query.find('&');
    const std::string_view pair = query.substr(0, end);
    const auto equals = pair.find('=');
    const bool has_value = equals != std::string_view::npos;
    const auto name = decode_component(pair.substr(0, equals), true);
    const auto value = decode_component(has_value ? pair.substr(equals + 1) : "", true);
    if (!name || !value) return bad("The query has a malformed percent sequence.");
    if (!pair.empty()) head.query.emplace_back(*name, *value);
    query = end == std::string_view::npos ? std::string_view() : query.substr(end + 1);
  }
  return {};
}

proto::Expected<void> parse_target(RequestHead& head) {
  if (head.target.size() > HeadLimits::kTarget)
    return proto::fail("uri_too_long", "The request target has over 4,096 bytes.");
  std::string_view target = head.target;
  // The absolute form is legal towards a server too.
  if (target.starts_with("http://") || target.starts_with("https://")) {
    const auto slash = target.find('/', target.find("//") + 2);
    target = slash == std::string_view::npos ? "/" : target.substr(slash);
  }
  if (target.empty() || (target[0] != '/' && target != "*"))
    return bad("The request target has to start with a slash.");
  target = target.substr(0, target.find('#'));
  const auto mark = target.find('?');
  const auto path = decode_component(target.substr(0, mark), false);
  if (!path) return bad("The path has a malformed percent sequence or a control character.");
  if (path->size() > HeadLimits::kPath)
    return proto::fail("uri_too_long", "The path has over 512 bytes.");
  head.path = *path;
  if (mark == std::string_view::npos) return {};
  return parse_query(target.substr(mark + 1), head);
}

proto::Expected<void> parse_request_line(std::string_view line, RequestHead& head) {
  const auto first = line.find(' '), last = line.rfind(' ');
  if (first == std::string_view::npos || first == last)
    return bad("The request line is malformed.");
  head.method = line.substr(0, first);
  head.target = line.substr(first + 1, last - first - 1);
  const auto version = line.substr(last + 1);
  if (version != "HTTP/1.1" && version != "HTTP/1.0")
    return bad("Only HTTP/1.1 and HTTP/1.0 are spoken here.");
  head.http_1_0 = version == "HTTP/1.0";
  if (!is_token(head.method)) return bad("The request line is malformed.");
  if (std::any_of(head.target.begin(), head.target.end(),
                  [](char c) { return is_control(c) || c == ' '; }))
    return bad("The request target has a space or a control character.");
  if (std::find(kMethods.begin(), kMethods.end(), head.method) == kMethods.end())
    return proto::fail("method_not_allowed", "The method " + head.method + " is not known here.");
  return parse_target(head);
}

proto::Expected<void> parse_header(std::string_view line, RequestHead& head) {
  const auto colon = line.find(':');
  if (colon == std::string_view::npos || !is_token(line.substr(0, colon)))
    return bad("A header line is malformed.");
  const std::string_view value = trim_blanks(line.substr(colon + 1));
  if (std::any_of(value.begin(), value.end(), [](char c) { return is_control(c) && c != '\t'; }))
    return bad("A header has a control character.");
  head.headers.emplace_back(line.substr(0, colon), value);
  return {};
}

proto::Expected<std::optional<std::uint64_t>> parse_length(const std::string* text) {
  if (!text) return std::nullopt;
  std::uint64_t value = 0;
  const char* end = text->data() + text->size();
  const auto parsed = std::from_chars(text->data(), end, value);
  if (parsed.ec != std::errc() || parsed.ptr != end)
    return bad("The Content-Length is not a number.");
  return value;
}

proto::Expected<void> check_framing(RequestHead& head) {
  const auto count = [&](std::string_view name) {
    return std::count_if(head.headers.begin(), head.headers.end(), [&](const auto& header) {
      return equal_ignoring_case(header.first, name);
    });
  };
  if (count("content-length") > 1) return bad("There are two Content-Length headers.");
  if (count("transfer-encoding") > 1) return bad("There are two Transfer-Encoding headers.");
  if (count("host") > 1 || (count("host") == 0 && !head.http_1_0))
    return bad("One Host header is needed.");
  const std::string* coding = head.header("transfer-encoding");
  auto length = parse_length(head.header("content-length"));
  if (!length) return proto::Unexpected(length.error());
  if (*length && coding) return bad("Content-Length and Transfer-Encoding exclude each other.");
  if (coding && (head.http_1_0 || !equal_ignoring_case(*coding, "chunked")))
    return bad("The only transfer coding known here is chunked, with HTTP/1.1.");
  head.chunked = coding != nullptr;
  head.content_length = *length;
  const bool bodiless = head.method == "GET" || head.method == "HEAD" || head.method == "DELETE";
  if (bodiless && head.has_body()) return bad("This method takes no body.");
  return {};
}

}  // namespace

const std::string* RequestHead::header(std::string_view name) const {
  for (const auto& [key, value] : headers)
    if (equal_ignoring_case(key, name)) return &value;
  return nullptr;
}

const std::string* RequestHead::query_value(std::string_view name) const {
  for (const auto& [key, value] : query)
    if (key == name) return &value;
  return nullptr;
}

bool RequestHead::wants_close() const {
  const std::string* connection = header("connection");
  if (http_1_0) return !connection || !equal_ignoring_case(*connection, "keep-alive");
  return connection && equal_ignoring_case(*connection, "close");
}

proto::Expected<RequestHead> parse_head(std::string_view bytes) {
  RequestHead head;
  auto line = take_line(bytes);
  if (!line) return bad("The request line does not end with CRLF.");
  if (auto ok = parse_request_line(*line, head); !ok) return proto::Unexpected(ok.error());
  for (;;) {
    line = take_line(bytes);
    if (!line) return bad("A header line does not end with CRLF.");
    if (line->empty()) break;
    if (head.headers.size() == HeadLimits::kHeaders)
      return proto::fail("headers_too_large", "The request has over 100 headers.");
    if (auto ok = parse_header(*line, head); !ok) return proto::Unexpected(ok.error());
  }
  if (auto ok = check_framing(head); !ok) return proto::Unexpected(ok.error());
  return head;
}

bool equal_ignoring_case(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](char x, char y) { return lower(x) == lower(y); });
}

std::string_view trim_blanks(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

std::optional<std::string> decode_component(std::string_view text, bool plus_is_space) {
  auto out = proto::percent_decode(text, plus_is_space);
  if (out && std::any_of(out->begin(), out->end(), is_control)) return std::nullopt;
  return out;
}

}  // namespace kiln::http
