#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <stop_token>
#include <utility>
#include <vector>

#include "proto/expected.h"

namespace kiln::exec {

/// Work that looks at a stop token here ends with this error.
using proto::canceled;

/// Tells an inner loop whether to stop. It looks once in 4096 calls.
class StopPoll {
 public:
  explicit StopPoll(std::stop_token stop) : stop_(std::move(stop)) {}
  bool operator()() { return (++calls_ & 4095u) == 0 && stop_.stop_requested(); }

 private:
  std::stop_token stop_;
  std::uint32_t calls_ = 0;
};

/// Resizes `values` piece by piece, since filling gigabytes takes seconds. Returns false when
/// stopped: the vector then has any size up to `size`. Requires that it does not shrink.
template <class T>
bool grow_unless_stopped(std::vector<T>& values, std::size_t size, const std::stop_token& stop) {
  constexpr std::size_t kPiece = std::max<std::size_t>((std::size_t(4) << 20) / sizeof(T), 1);
  values.reserve(size);
  while (values.size() < size) {
    if (stop.stop_requested()) return false;
    values.resize(values.size() + std::min(kPiece, size - values.size()));
  }
  return true;
}

/// Sorts like std::stable_sort by merging sorted runs, so that a stop request is seen between two
/// of them. Returns false when stopped: the order is then undefined.
template <class T, class Less>
bool sort_unless_stopped(std::vector<T>& values, Less less, const std::stop_token& stop) {
  constexpr std::size_t kRun = std::size_t(1) << 16;
  const auto at = [&](std::size_t i) {
    return values.begin() + std::ptrdiff_t(std::min(i, values.size()));
  };
  for (std::size_t i = 0; i < values.size(); i += kRun) {
    if (stop.stop_requested()) return false;
    std::stable_sort(at(i), at(i + kRun), less);
  }
  std::vector<T> merged;
  for (std::size_t run = kRun; run < values.size(); run *= 2) {
    merged.clear();
    merged.reserve(values.size());
    for (std::size_t i = 0; i < values.size(); i += 2 * run) {
      if (stop.stop_requested()) return false;
      std::merge(at(i), at(i + run), at(i + run), at(i + 2 * run), std::back_inserter(merged),
                 less);
    }
    values.swap(merged);
  }
  return true;
}

}  // namespace kiln::exec
