#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>

namespace kiln::exec {

/// The fixed set of threads that runs the batches of all jobs.
class ThreadPool {
 public:
  explicit ThreadPool(unsigned threads);  ///< at least one; FTZ and DAZ are set in each
  ~ThreadPool();                          ///< waits for running batches
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  unsigned size() const;

  /// Runs `batch(0) ... batch(count - 1)` on the pool and waits for all: the barrier between two
  /// passes. Jobs that wait here at the same time take turns batch by batch. Returns false when
  /// `stop` was requested (some batches then did not run). An exception of a batch is thrown here.
  /// Callable from many threads, but not from inside a batch.
  bool for_batches(std::uint32_t count, std::stop_token stop,
                   const std::function<void(std::uint32_t)>& batch);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::exec
