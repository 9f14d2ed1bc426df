#pragma once

#include <string>
#include <vector>

#include "proto/expected.h"

namespace kiln::proto {

/// Collects what is wrong with a document, so that all of it is told at once. A hostile document
/// can't make it large: places beyond kMaxPlaces are only counted.
class ProblemList {
 public:
  static constexpr std::size_t kMaxPlaces = 64;

  explicit ProblemList(std::string source) : source_(std::move(source)) {}

  void add(std::string pointer, std::string detail);
  bool empty() const { return count_ == 0; }
  /// The error with all places; requires !empty().
  Error error(std::string code) &&;

 private:
  std::string source_;
  std::vector<ErrorDetail> places_;
  std::size_t count_ = 0;
};

}  // namespace kiln::proto
