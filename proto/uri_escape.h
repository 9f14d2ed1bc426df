#pragma once

#include <optional>
#include <string>
#include <string_view>

/// Percent escapes of URIs (RFC 3986, section 2.1).
namespace kiln::proto {

/// Replaces each %XX by its byte. Nothing when a '%' is not followed by two hexadecimal digits.
std::optional<std::string> percent_decode(std::string_view);

/// Writes every byte but the unreserved characters (RFC 3986, section 2.3) as %XX.
std::string percent_encode(std::string_view);

}  // namespace kiln::proto
