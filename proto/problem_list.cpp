#include "proto/problem_list.h"

#include <utility>

namespace kiln::proto {

void ProblemList::add(std::string pointer, std::string detail) {
  if (++count_ > kMaxPlaces) return;
  places_.push_back({source_, std::move(pointer), std::move(detail)});
}

Error ProblemList::error(std::string code) && {
  const auto& first = places_.front();
  std::string message = (first.pointer.empty() ? source_ : first.pointer) + ": " + first.detail;
  if (count_ > 1) message += " (and " + std::to_string(count_ - 1) + " more)";
  return {std::move(code), std::move(message), std::move(places_)};
}

}  // namespace kiln::proto
