#pragma once

#include <pthread.h>

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <vector>

namespace kiln::http {

/// Runs threads that answer requests, with stacks of a known size whatever the platform's default.
class WorkerPool {
 public:
  static constexpr std::size_t kStackBytes = 8 << 20;

  WorkerPool(unsigned threads, std::size_t max_waiting);
  ~WorkerPool();  ///< runs what waits, then joins
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// Queues a task. Returns false when too much is waiting: the task was not taken.
  bool enqueue(std::function<void()> task);
  /// Queues what was taken before, and so is not refused. It is lost once the pool is stopping.
  void enqueue_again(std::function<void()> task);
  void stop();

 private:
  struct Task {
    std::function<void()> run;
    bool fresh = true;
  };
  static void* entry(void* self);
  void loop();

  std::size_t max_waiting_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Task> tasks_;  ///< guarded by mutex_
  std::size_t fresh_ = 0;   ///< number of fresh ones among these; guarded by mutex_
  bool stopping_ = false;   ///< guarded by mutex_
  std::vector<pthread_t> threads_;
};

}  // namespace kiln::http
