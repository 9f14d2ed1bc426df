#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>

#include "baker/exec/thread_pool.h"

namespace kiln::exec {

/// Tells where one job's work runs, and what ends it early.
struct Workers {
  ThreadPool& pool;
  std::stop_token stop;

  /// Calls `use(begin, end)` for runs of at most `size` that cover [0, count), and waits for all.
  /// Returns false when stopped.
  bool for_runs(std::uint32_t count, std::uint32_t size,
                const std::function<void(std::uint32_t begin, std::uint32_t end)>& use) const {
    return pool.for_batches((count + size - 1) / size, stop, [&](std::uint32_t i) {
      use(i * size, i + 1 < (count + size - 1) / size ? (i + 1) * size : count);
    });
  }
};

}  // namespace kiln::exec
