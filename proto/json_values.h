#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace kiln::proto {

/// Returns the double with the fewest decimal digits that rounds to `v` as float. So 0.001f is
/// written as 0.001, not as 0.0010000000474974513.
double shortest_number(float v);

/// Returns the value as JSON, or null.
nlohmann::json or_null(const std::optional<double>&);

/// Returns one reference token of a JSON pointer (RFC 6901), with '~' and '/' escaped.
std::string pointer_token(std::string_view key);

/// Returns the value as one short line for a message: at most ~60 characters, always valid UTF-8.
std::string brief_value(const nlohmann::json&);
/// Returns the text; when it is longer than `bytes` bytes it is cut between two characters, and
/// "..." follows.
std::string brief(std::string_view text, std::size_t bytes = 60);

}  // namespace kiln::proto
