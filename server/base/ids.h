#pragma once

#include <chrono>
#include <string>
#include <string_view>

namespace kiln::base {

/// `prefix` + 26 characters of [0-9a-z]: 48 bits of time, then 80 random bits, so that ids sort by
/// age and can't be guessed.
std::string new_id(std::string_view prefix);

/// `prefix` + 52 random characters of [0-9a-z]: 260 bits that nobody guesses.
std::string new_secret(std::string_view prefix);

/// Whether `text` is `prefix` + 26 characters of [0-9a-z].
bool is_id(std::string_view text, std::string_view prefix);

/// The time now, or so many seconds later: RFC 3339, UTC, with milliseconds. Such texts sort by
/// time.
std::string now_rfc3339(std::chrono::seconds later = {});
/// The time so many seconds after one that now_rfc3339() gave; "" when it is not of that form.
std::string seconds_after(const std::string& rfc3339, std::chrono::seconds);

}  // namespace kiln::base
