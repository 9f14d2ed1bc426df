#pragma once

#include <string>
#include <vector>

#include "proto/expected.h"

namespace kiln::proto {

/// Collects the problems of a document, so that one error reports them all. A hostile document
/// can't make the list large: places beyond kMaxPlaces are only counted.
class ProblemList {
 public:
  static constexpr std::size_t kMaxPlaces = 64;

  explicit ProblemList(std::string source) : source_(std::move(source)) {}

  void add(std::string pointer, std::string detail);
  bool empty() const { return count_ == 0; }
  /// Returns the error with all places. Requires !empty().
  Error error(std::string code) &&;

 private:
  std::string source_;
  std::vector<ErrorDetail> places_;
  std::size_t count_ = 0;
};

}  // namespace kiln::proto
