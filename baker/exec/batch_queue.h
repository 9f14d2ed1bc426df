#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>

#include "baker/exec/thread_pool.h"
#include "proto/expected.h"

namespace kiln::exec {

/// Runs the batches of one pass for a queue, which decides where and in which order they run. A
/// queue calls for each batch either run(), in this process, or take() with the bytes that
/// compute() gave for it in another process, which holds the same inputs.
class BatchWork {
 public:
  virtual ~BatchWork() = default;
  /// Computes a batch in place. Different batches may run on different threads at once.
  virtual void run(std::uint32_t batch) = 0;
  /// Computes a batch, leaves everything as it was, and returns what it brought. Any thread may
  /// call it.
  virtual std::string compute(std::uint32_t batch) = 0;
  /// Takes in what compute() returned somewhere for this batch. The bytes come from outside and are
  /// checked. Any thread. Errors: those of the check.
  virtual proto::Expected<void> take(std::uint32_t batch, std::string_view bytes) = 0;
};

/// Runs the batches of passes somewhere. Callable from many threads, one for each job.
class BatchQueue {
 public:
  virtual ~BatchQueue() = default;
  /// Runs each of the batches once, in any order, and waits for them: the barrier between two
  /// passes. Jobs that wait at the same time take turns batch by batch.
  /// @param on_done called after each batch, from any thread, for different batches at once
  /// Errors: `canceled` within a second of a stop request, some batches then did not run; those of
  /// BatchWork::take(), after which no further batch begins. An exception of a batch is thrown
  /// here.
  virtual proto::Expected<void> run(std::span<const std::uint32_t> batches, BatchWork&,
                                    const std::function<void(std::uint32_t batch)>& on_done,
                                    std::stop_token) = 0;
};

/// Runs batches in place on the threads of this process, in the order given.
class LocalQueue final : public BatchQueue {
 public:
  explicit LocalQueue(ThreadPool& pool) : pool_(pool) {}
  proto::Expected<void> run(std::span<const std::uint32_t> batches, BatchWork&,
                            const std::function<void(std::uint32_t)>& on_done,
                            std::stop_token) override;

 private:
  ThreadPool& pool_;
};

}  // namespace kiln::exec
