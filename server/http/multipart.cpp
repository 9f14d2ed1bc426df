#include "server/http/multipart.h"

#include <algorithm>
#include <map>

#include "server/http/head.h"

namespace kiln::http {
namespace {

using Parameters = std::map<std::string, std::string>;

proto::Unexpected bad(const char* what) {
  return proto::fail("bad_request", what, "request", "");
}

// Reads `token` or `"quoted \" string"` off the front. Browsers and curl escape a quote as \" or
// %22; a backslash before anything else is kept, for Windows paths have them.
std::optional<std::string> take_value(std::string_view& rest) {
  std::string value;
  if (rest.empty() || rest.front() != '"') {
    const auto end = std::min(rest.find(';'), rest.size());
    value = trim_blanks(rest.substr(0, end));
    rest.remove_prefix(end);
    return value;
  }
  for (std::size_t i = 1; i < rest.size(); ++i) {
    if (rest[i] == '"') {
      rest.remove_prefix(i + 1);
      return value;
    }
    const bool escaped =
        rest[i] == '\\' && i + 1 < rest.size() && (rest[i + 1] == '"' || rest[i + 1] == '\\');
    if (escaped) ++i;
    value += rest[i];
  }
  return std::nullopt;
}

// `type; key=value; key="value"` as a map with lower-case keys; the bare type under "".
std::optional<Parameters> parse_parameters(std::string_view text) {
  Parameters parameters;
  const auto first = text.find(';');
  parameters[""] = trim_blanks(text.substr(0, first));
  std::string_view rest = first == std::string_view::npos ? "" : text.substr(first);
  for (;;) {
    rest = trim_blanks(rest);
    if (rest.empty()) return parameters;
    if (rest.front() != ';') return std::nullopt;
    rest = trim_blanks(rest.substr(1));
    if (rest.empty()) return parameters;
    const auto equals = rest.find('=');
    if (equals == std::string_view::npos) return std::nullopt;
    std::string key(trim_blanks(rest.substr(0, equals)));
    std::transform(key.begin(), key.end(), key.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    rest = trim_blanks(rest.substr(equals + 1));
    auto value = take_value(rest);
    if (!value || !parameters.emplace(std::move(key), std::move(*value)).second)
      return std::nullopt;
  }
}

// RFC 8187: charset'language'percent-encoded. UTF-8 only.
std::optional<std::string> decode_extended(std::string_view text) {
  const auto first = text.find('\'');
  const auto second = first == std::string_view::npos ? first : text.find('\'', first + 1);
  if (second == std::string_view::npos || !equal_ignoring_case(text.substr(0, first), "utf-8"))
    return std::nullopt;
  return decode_component(text.substr(second + 1), false);
}

}  // namespace

std::optional<std::string> multipart_boundary(std::string_view content_type) {
  const auto parameters = parse_parameters(content_type);
  if (!parameters || !equal_ignoring_case(parameters->at(""), "multipart/form-data"))
    return std::nullopt;
  const auto found = parameters->find("boundary");
  if (found == parameters->end() || found->second.empty() || found->second.size() > 70)
    return std::nullopt;
  return found->second;
}

proto::Expected<PartHead> parse_part_head(std::string_view lines) {
  PartHead head;
  bool named = false;
  while (!lines.empty()) {
    const auto end = std::min(lines.find("\r\n"), lines.size());
    const std::string_view line = lines.substr(0, end);
    lines.remove_prefix(std::min(end + 2, lines.size()));
    const auto colon = line.find(':');
    if (colon == std::string_view::npos) return bad("A part's header line is malformed.");
    const auto key = trim_blanks(line.substr(0, colon));
    const auto value = trim_blanks(line.substr(colon + 1));
    if (equal_ignoring_case(key, "content-type")) head.content_type = value;
    if (!equal_ignoring_case(key, "content-disposition")) continue;
    const auto parameters = parse_parameters(value);
    if (named || !parameters || !equal_ignoring_case(parameters->at(""), "form-data") ||
        !parameters->contains("name"))
      return bad("A part's Content-Disposition is malformed.");
    named = true;
    head.name = parameters->at("name");
    if (const auto it = parameters->find("filename"); it != parameters->end())
      head.filename = it->second;
    if (const auto it = parameters->find("filename*"); it != parameters->end())
      if (auto decoded = decode_extended(it->second)) head.filename = *decoded;
  }
  if (!named) return bad("A part has no Content-Disposition.");
  return head;
}

MultipartReader::MultipartReader(std::string boundary, PartSink sink)
    : delimiter_("\r\n--" + std::move(boundary)), sink_(std::move(sink)), buffer_("\r\n") {}

proto::Expected<void> MultipartReader::feed(std::string_view bytes) {
  buffer_ += bytes;
  for (;;) {
    auto more = step();
    if (!more) return proto::Unexpected(more.error());
    if (!*more) break;
  }
  // What is kept is short, and so is its memory: thousands of bodies may be arriving.
  std::string(buffer_, at_).swap(buffer_);
  at_ = 0;
  return {};
}

proto::Expected<void> MultipartReader::finish() const {
  if (state_ != State::kEpilogue) return bad("The multipart body ends before its last boundary.");
  return {};
}

MultipartReader::Step MultipartReader::step() {
  switch (state_) {
    case State::kPreamble:
      return read_preamble();
    case State::kAfterBoundary:
      return read_after_boundary();
    case State::kHead:
      return read_head();
    case State::kBody:
      return read_body();
    case State::kEpilogue:
      at_ = buffer_.size();
      return false;
  }
  return false;
}

MultipartReader::Step MultipartReader::read_preamble() {
  const auto found = buffer_.find(delimiter_, at_);
  if (found == std::string::npos) {
    if (buffer_.size() > kMaxPartHead)
      return bad("The multipart body does not start with its boundary.");
    return false;
  }
  at_ = found + delimiter_.size();
  state_ = State::kAfterBoundary;
  return true;
}

MultipartReader::Step MultipartReader::read_after_boundary() {
  if (buffer_.size() - at_ < 2) return false;
  const std::string_view next = std::string_view(buffer_).substr(at_, 2);
  if (next == "--") {
    state_ = State::kEpilogue;
  } else if (next == "\r\n") {
    state_ = State::kHead;
    if (++parts_ > kMaxParts) return bad("The multipart body has over 256 parts.");
  } else {
    return bad("A multipart boundary is followed by other bytes.");
  }
  at_ += 2;
  return true;
}

MultipartReader::Step MultipartReader::read_head() {
  const auto found = buffer_.find("\r\n\r\n", at_);
  if (found == std::string::npos || found - at_ > kMaxPartHead) {
    if (buffer_.size() - at_ > kMaxPartHead) return bad("A part's headers are over 8 KiB.");
    return false;
  }
  auto head = parse_part_head(std::string_view(buffer_).substr(at_, found - at_));
  if (!head) return proto::Unexpected(head.error());
  // The CRLF of the empty line stays: an empty part's delimiter begins with it.
  at_ = found + 2;
  state_ = State::kBody;
  body_begins_ = true;
  if (auto ok = sink_.begin(*head); !ok) return proto::Unexpected(ok.error());
  return true;
}

MultipartReader::Step MultipartReader::read_body() {
  const auto found = buffer_.find(delimiter_, at_);
  const bool whole = found != std::string::npos;
  if (!whole && buffer_.size() - at_ < delimiter_.size()) return false;
  if (body_begins_ && (!whole || found > at_)) at_ += 2;
  body_begins_ = false;
  // Without the delimiter, hold back what may be its beginning.
  const std::size_t end = whole ? found : buffer_.size() - (delimiter_.size() - 1);
  if (end > at_) {
    if (auto ok = sink_.data(std::string_view(buffer_).substr(at_, end - at_)); !ok)
      return proto::Unexpected(ok.error());
    at_ = end;
  }
  if (!whole) return false;
  at_ = found + delimiter_.size();
  state_ = State::kAfterBoundary;
  if (auto ok = sink_.end(); !ok) return proto::Unexpected(ok.error());
  return true;
}

}  // namespace kiln::http
