#include "proto/nearest_name.h"

#include <algorithm>

namespace kiln::proto {
namespace {

constexpr std::size_t kMaxCompared = 64;  // Longer names are no misspellings of known ones.

std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({change, last[j] + 1, row[j - 1] + 1});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
    std::swap(before, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

}  // namespace

std::string nearest_name(std::string_view name, const std::vector<std::string_view>& known) {
  if (name.size() > kMaxCompared) return {};
  std::string_view best;
  std::size_t best_edits = std::max<std::size_t>(2, name.size() / 3) + 1;
  for (const auto candidate : known) {
    const std::size_t n = edits(name, candidate);
    if (n < best_edits && n < candidate.size()) {
      best = candidate;
      best_edits = n;
    }
  }
  return std::string(best);
}

std::string name_hint(std::string_view name, const std::vector<std::string_view>& known) {
  if (const auto near = nearest_name(name, known); !near.empty())
    return "; did you mean \"" + near + "\"?";
  std::string list;
  for (const auto word : known) list += (list.empty() ? "\"" : ", \"") + std::string(word) + "\"";
  return "; known: " + list;
}

}  // namespace kiln::proto
