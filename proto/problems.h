#pragma once

#include <string_view>
#include <vector>

namespace kiln::proto {

/// The meaning of an error code for an HTTP client.
struct ProblemKind {
  std::string_view code;
  int status;
  std::string_view title;
};

/// Returns all codes that leave the service, in alphabetical order.
const std::vector<ProblemKind>& problem_kinds();

/// Returns the kind of a code, or the kind of `internal` for a code that is not in the table.
const ProblemKind& problem_kind(std::string_view code);

}  // namespace kiln::proto
