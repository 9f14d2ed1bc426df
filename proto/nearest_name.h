#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace kiln::proto {

/// Returns the known name that is nearest to a misspelled one, by the number of insertions,
/// deletions, substitutions and swaps of neighbors. Names within a third of its length (but at
/// least 2) count as near. Returns "" when none is near.
std::string nearest_name(std::string_view name, const std::vector<std::string_view>& known);

/// Returns "; did you mean \"bounces\"?" or, when none is near, "; known: \"bounces\", ...".
std::string name_hint(std::string_view name, const std::vector<std::string_view>& known);

}  // namespace kiln::proto
