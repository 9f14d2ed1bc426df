#include "server/http/conditional.h"

#include <algorithm>
#include <charconv>
#include <optional>

namespace kiln::http {
namespace {

// Reads a number, digits only. A number beyond 64 bits counts as the largest: it is past any file's
// end.
std::optional<std::uint64_t> number(std::string_view text) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (text.empty() || !std::all_of(text.begin(), text.end(), is_digit)) return std::nullopt;
  std::uint64_t value = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
  return parsed.ec == std::errc() ? value : UINT64_MAX;
}

// Reads one range specifier. Returns nothing when it is malformed.
std::optional<Selection> resolve(std::string_view spec, std::uint64_t size) {
  constexpr Selection kUnsatisfiable{416, 0, 0};
  const auto dash = spec.find('-');
  if (dash == std::string_view::npos) return std::nullopt;
  const auto first_text = trim_blanks(spec.substr(0, dash));
  const auto last_text = trim_blanks(spec.substr(dash + 1));
  const auto first = number(first_text), last = number(last_text);
  if (first_text.empty()) {  // the last n bytes
    if (!last) return std::nullopt;
    if (*last == 0 || size == 0) return kUnsatisfiable;
    const std::uint64_t length = std::min(*last, size);
    return Selection{206, size - length, length};
  }
  if (!first || (!last && !last_text.empty())) return std::nullopt;
  if (last && *last < *first) return std::nullopt;
  if (*first >= size) return kUnsatisfiable;
  const std::uint64_t end = last ? std::min(*last, size - 1) : size - 1;
  return Selection{206, *first, end - *first + 1};
}

bool matches(std::string_view list, std::string_view etag, bool weakly) {
  if (trim_blanks(list) == "*") return true;
  while (!list.empty()) {
    const auto comma = list.find(',');  // our tags hold no comma, so none of ours is cut in two
    std::string_view tag = trim_blanks(list.substr(0, comma));
    if (weakly && tag.starts_with("W/")) tag.remove_prefix(2);
    if (tag == etag) return true;
    list = comma == std::string_view::npos ? std::string_view() : list.substr(comma + 1);
  }
  return false;
}

}  // namespace

bool matches_etag(std::string_view list, std::string_view etag) {
  return matches(list, etag, true);
}

bool matches_strongly(std::string_view list, std::string_view etag) {
  return matches(list, etag, false);
}

Selection select_content(const RequestHead& head, std::string_view etag, std::uint64_t size) {
  if (const auto* list = head.header("if-none-match"); list && matches_etag(*list, etag))
    return {304, 0, 0};
  const Selection whole{200, 0, size};
  const auto* range = head.header("range");
  if (!range || head.method != "GET") return whole;
  if (const auto* condition = head.header("if-range"); condition && *condition != etag)
    return whole;
  std::string_view text = *range;
  const auto equals = text.find('=');
  if (equals == std::string_view::npos ||
      !equal_ignoring_case(trim_blanks(text.substr(0, equals)), "bytes"))
    return whole;
  text.remove_prefix(equals + 1);
  if (text.find(',') != std::string_view::npos) return {416, 0, 0};
  return resolve(text, size).value_or(whole);
}

}  // namespace kiln::http
