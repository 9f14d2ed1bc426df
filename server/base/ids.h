#pragma once

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

}  // namespace kiln::base
