#pragma once

#include <string_view>
#include <vector>

namespace kiln::proto {

/// What an error code means to an HTTP client.
struct ProblemKind {
  std::string_view code;
  int status;
  std::string_view title;
};

/// All codes that leave the service, in alphabetical order.
const std::vector<ProblemKind>& problem_kinds();

/// The kind of a code; for one that is not in the table the kind of `internal`.
const ProblemKind& problem_kind(std::string_view code);

}  // namespace kiln::proto
