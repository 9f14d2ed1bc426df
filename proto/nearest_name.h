#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace kiln::proto {

/// The known name that a misspelt one was most likely meant to be: fewest insertions, deletions,
/// substitutions and swaps of neighbors, at most a third of its length (but at least 2). "" when
/// none is near.
std::string nearest_name(std::string_view name, const std::vector<std::string_view>& known);

/// "; did you mean \"bounces\"?" or, when none is near, "; known: \"bounces\", ...".
std::string name_hint(std::string_view name, const std::vector<std::string_view>& known);

}  // namespace kiln::proto
