#include "baker/exec/thread_pool.h"

#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <condition_variable>
#include <exception>
#include <list>
#include <mutex>
#include <thread>
#include <vector>

namespace kiln::exec {
namespace {

/// One for_batches() call: numbers are handed out in order, and counted when they come back.
struct BatchSet {
  std::uint32_t count = 0, next = 0, finished = 0;
  std::stop_token stop;
  const std::function<void(std::uint32_t)>* batch = nullptr;
  std::exception_ptr error;
  std::condition_variable done;

  bool exhausted() const { return next == count || error || stop.stop_requested(); }
  bool complete() const { return exhausted() && finished == next; }
};

}  // namespace

struct ThreadPool::Impl {
  std::mutex mutex;
  std::condition_variable_any work;
  std::list<BatchSet*> turns;  ///< sets with batches left, the next to be served first; by `mutex`
  std::vector<std::jthread> threads;

  /// Takes one batch of the set whose turn it is and sends that set to the end of the line.
  BatchSet* take(std::uint32_t& index) {
    while (!turns.empty()) {
      BatchSet* set = turns.front();
      turns.pop_front();
      if (set->exhausted()) {
        set->done.notify_all();
        continue;
      }
      index = set->next++;
      if (set->next < set->count) turns.push_back(set);
      return set;
    }
    return nullptr;
  }

  void work_until(const std::stop_token& quit) {
    // Denormals cost hundreds of cycles each and mean nothing in light.
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    std::unique_lock lock(mutex);
    while (work.wait(lock, quit, [this] { return !turns.empty(); })) {
      std::uint32_t index = 0;
      BatchSet* set = take(index);
      if (!set) continue;
      lock.unlock();
      std::exception_ptr error;
      try {
        (*set->batch)(index);
      } catch (...) {
        error = std::current_exception();
      }
      lock.lock();
      ++set->finished;
      if (error && !set->error) set->error = error;
      if (set->complete()) set->done.notify_all();
    }
  }
};

ThreadPool::ThreadPool(unsigned threads) : impl_(std::make_unique<Impl>()) {
  for (unsigned i = 0; i < std::max(1u, threads); ++i)
    impl_->threads.emplace_back([this](std::stop_token quit) { impl_->work_until(quit); });
}

ThreadPool::~ThreadPool() {
  for (auto& t : impl_->threads) t.request_stop();
  impl_->threads.clear();  // joins
}

unsigned ThreadPool::size() const {
  return static_cast<unsigned>(impl_->threads.size());
}

bool ThreadPool::for_batches(std::uint32_t count, std::stop_token stop,
                             const std::function<void(std::uint32_t)>& batch) {
  if (stop.stop_requested()) return false;
  if (count == 0) return true;
  BatchSet set;
  set.count = count;
  set.stop = stop;
  set.batch = &batch;
  // A stop request leaves the set in the line; the wait must wake for it without a worker's help.
  // Before the lock: where the request has come already, the callback runs here and now.
  const std::stop_callback wake(stop, [this, &set] {
    const std::lock_guard guard(impl_->mutex);
    set.done.notify_all();
  });
  std::unique_lock lock(impl_->mutex);
  impl_->turns.push_back(&set);
  impl_->work.notify_all();
  set.done.wait(lock, [&set] { return set.complete(); });
  impl_->turns.remove(&set);
  lock.unlock();  // before `wake` goes: its callback may be waiting for the mutex
  if (set.error) std::rethrow_exception(set.error);
  return set.next == set.count && !stop.stop_requested();
}

}  // namespace kiln::exec
