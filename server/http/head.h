#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/expected.h"

namespace kiln::http {

/// The head of a request as it came over the wire, checked strictly enough that no proxy can read
/// another request out of the same bytes. Header values are raw: only path and query are decoded.
struct RequestHead {
  std::string method;
  std::string target;                                      ///< as sent
  std::string path;                                        ///< percent-decoded, without the query
  std::vector<std::pair<std::string, std::string>> query;  ///< decoded, in order
  std::vector<std::pair<std::string, std::string>> headers;
  bool http_1_0 = false;
  bool chunked = false;
  std::optional<std::uint64_t> content_length;

  /// The header's value, null when absent. Names are compared without case.
  const std::string* header(std::string_view name) const;
  const std::string* query_value(std::string_view name) const;
  bool has_body() const { return chunked || content_length.value_or(0) > 0; }
  bool wants_close() const;
};

struct HeadLimits {
  static constexpr std::size_t kBytes = std::size_t{32} * 1024;
  static constexpr std::size_t kPath = 512;
  static constexpr std::size_t kTarget = 4096;
  static constexpr std::size_t kHeaders = 100;
};

/// Parses a head that ends with its empty line. Refuses: line ends other than CRLF, folded lines,
/// bytes that don't belong, a space before the colon, two Content-Length, Content-Length together
/// with Transfer-Encoding, any transfer coding but chunked, a body on GET, HEAD or DELETE, no Host
/// in HTTP/1.1. Errors: `bad_request`, `uri_too_long`, `headers_too_large`, `method_not_allowed`.
proto::Expected<RequestHead> parse_head(std::string_view bytes);

bool equal_ignoring_case(std::string_view, std::string_view);
std::string_view trim_blanks(std::string_view);

/// Decodes a part of a URL. Nothing when an escape is malformed or a byte is a control character.
std::optional<std::string> decode_component(std::string_view, bool plus_is_space);

}  // namespace kiln::http
