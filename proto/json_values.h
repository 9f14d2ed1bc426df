#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace kiln::proto {

/// The double with the fewest decimal digits that rounds to `v` as float: 0.001f is written as
/// 0.001, not as 0.0010000000474974513.
double shortest_number(float v);

/// The value, or null.
nlohmann::json or_null(const std::optional<double>&);

/// One reference token of a JSON pointer (RFC 6901): '~' and '/' escaped.
std::string pointer_token(std::string_view key);

/// The value as one short line for a message: at most ~60 characters, always valid UTF-8.
std::string brief_value(const nlohmann::json&);
/// The text, cut at a character's border to at most `bytes` bytes and "...".
std::string brief(std::string_view text, std::size_t bytes = 60);

}  // namespace kiln::proto
