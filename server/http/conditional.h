#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "server/http/head.h"

namespace kiln::http {

/// The answer to a request for a file.
struct Selection {
  int status = 200;  ///< 200, 206, 304 or 416
  std::uint64_t offset = 0, length = 0;
};

/// Evaluates If-None-Match, If-Range and Range (RFC 9110) against one strong ETag. A Range that is
/// malformed or of another unit is ignored, as the standard asks; several ranges are refused (416).
Selection select_content(const RequestHead&, std::string_view etag, std::uint64_t size);

/// Returns whether a list of entity tags (or *) names `etag`, by weak comparison.
bool matches_etag(std::string_view list, std::string_view etag);

/// Returns the same by strong comparison, as If-Match asks for: a weak tag names nothing.
bool matches_strongly(std::string_view list, std::string_view etag);

}  // namespace kiln::http
