#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>
#include <vector>

namespace kiln::proto {

/// One place in the input that is wrong. `source` says which document the pointer points into:
/// "scene" (the glTF document), "settings" (the settings object) or "request" (headers, query,
/// multipart parts).
struct ErrorDetail {
  std::string source;
  std::string pointer;  ///< JSON pointer (RFC 6901), "" for the whole document
  std::string detail;   ///< says what was found there and what was expected
};

/// An expected failure: bad input, a limit, a cancellation. Bugs are exceptions, not Errors.
struct Error {
  std::string code;     ///< stable, machine readable: "invalid_settings", "no_light", ...
  std::string message;  ///< one sentence for a person
  std::vector<ErrorDetail> details;
};

template <class T>
using Expected = tl::expected<T, Error>;
using Unexpected = tl::unexpected<Error>;

/// Makes an error with one place.
inline Unexpected fail(std::string code, std::string message, std::string source,
                       std::string pointer) {
  Error e{std::move(code), message, {}};
  e.details.push_back({std::move(source), std::move(pointer), std::move(message)});
  return Unexpected(std::move(e));
}

/// Makes an error without a place, when no field is at fault.
inline Unexpected fail(std::string code, std::string message) {
  return Unexpected(Error{std::move(code), std::move(message), {}});
}

/// The error code of a job or stage that a stop request ended.
inline constexpr const char* kCanceledCode = "canceled";

/// Returns the error of work that a stop request ended.
inline Unexpected canceled() {
  return fail(kCanceledCode, "The job was canceled.");
}

}  // namespace kiln::proto
