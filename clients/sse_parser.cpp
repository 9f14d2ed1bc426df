#include "clients/sse_parser.h"

#include <charconv>

namespace kiln::clients {
namespace {

/// Returns the whole text as a number, or nothing.
template <class T>
std::optional<T> number(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || text.empty()) return {};
  return value;
}

}  // namespace

bool SseParser::feed(std::string_view bytes, const Handler& handler) {
  for (const char c : bytes) {
    const bool second_half = after_return_ && c == '\n';
    after_return_ = c == '\r';
    if (second_half) continue;
    if (c == '\r' || c == '\n') {
      if (!end_line(handler)) return false;
      continue;
    }
    if (line_.size() + data_.size() >= kMaxEventBytes) {
      overflowed_ = true;
      return false;
    }
    line_ += c;
  }
  return true;
}

void SseParser::reconnect() {
  line_.clear();
  type_.clear();
  data_.clear();
  id_ = 0;
  has_data_ = after_return_ = false;
  first_line_ = true;
}

bool SseParser::end_line(const Handler& handler) {
  const std::string taken = std::move(line_);
  line_.clear();
  std::string_view line = taken;
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (first_line_ && line.substr(0, 3) == kByteOrderMark) line.remove_prefix(3);
  first_line_ = false;
  if (line.empty()) return dispatch(handler);
  const auto colon = line.find(':');
  if (colon == 0) return true;  // a comment, as the heartbeat is
  auto value = colon == std::string_view::npos ? std::string_view{} : line.substr(colon + 1);
  if (!value.empty() && value.front() == ' ') value.remove_prefix(1);
  field(line.substr(0, colon), value);
  return true;
}

void SseParser::field(std::string_view name, std::string_view value) {
  if (name == "event") {
    type_ = value;
  } else if (name == "data") {
    if (has_data_) data_ += '\n';
    data_ += value;
    has_data_ = true;
  } else if (name == "id") {
    if (const auto id = number<std::uint64_t>(value)) last_id_ = id_ = *id;
  } else if (name == "retry") {
    if (const auto ms = number<std::uint32_t>(value)) retry_ms_ = *ms;
  }
}

bool SseParser::dispatch(const Handler& handler) {
  proto::Event event{id_, type_.empty() ? "message" : std::move(type_), std::move(data_)};
  const bool whole = has_data_;
  type_.clear();
  data_.clear();
  id_ = 0;
  has_data_ = false;
  return !whole || handler(event);
}

}  // namespace kiln::clients
