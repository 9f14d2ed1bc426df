#pragma once

#include <optional>
#include <string>
#include <string_view>

/// Codes in which text carries other bytes.
namespace kiln::proto {

/// Decodes the percent escapes of a URI; `+` means a space where `plus_is_space`, as in a form.
/// Returns nothing when a '%' is not followed by two hexadecimal digits.
std::optional<std::string> percent_decode(std::string_view, bool plus_is_space = false);

/// Writes every byte but the unreserved characters of a URI (RFC 3986, section 2.3) as %XX.
std::string percent_encode(std::string_view);

/// Writes bytes as base64 of the plain alphabet, with padding (RFC 4648, section 4).
std::string base64_encode(std::string_view bytes);

/// Decodes base64 of the plain or the URL-safe alphabet, with or without padding: writers of glTF
/// use all of them, and OpenSSL's decoder takes the first with padding only. Returns nothing for
/// other letters, wrong padding or an impossible length.
std::optional<std::string> base64_decode(std::string_view);

}  // namespace kiln::proto
