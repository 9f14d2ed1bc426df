#pragma once

#include <optional>
#include <string>
#include <string_view>

/// Base64 with padding (RFC 4648, section 4), by OpenSSL.
namespace kiln::proto {

std::string base64_encode(std::string_view bytes);

/// Nothing when a character is not of the alphabet, or when the padding is missing or misplaced.
std::optional<std::string> base64_decode(std::string_view text);

}  // namespace kiln::proto
