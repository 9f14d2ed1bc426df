#include "server/http/worker_pool.h"

#include <csignal>
#include <new>
#include <system_error>

namespace kiln::http {

WorkerPool::WorkerPool(unsigned threads, std::size_t max_waiting) : max_waiting_(max_waiting) {
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, kStackBytes);
  for (unsigned i = 0; i < threads; ++i) {
    pthread_t thread{};
    const int error = pthread_create(&thread, &attributes, &entry, this);
    if (error != 0) {
      pthread_attr_destroy(&attributes);
      stop();
      throw std::system_error(error, std::system_category(), "request threads");
    }
    threads_.push_back(thread);
  }
  pthread_attr_destroy(&attributes);
}

WorkerPool::~WorkerPool() {
  stop();
}

void WorkerPool::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  for (const pthread_t thread : threads_) pthread_join(thread, nullptr);
  threads_.clear();
}

bool WorkerPool::enqueue(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (stopping_ || fresh_ >= max_waiting_) return false;
    tasks_.push_back({std::move(task)});
    ++fresh_;
  }
  changed_.notify_one();
  return true;
}

void WorkerPool::enqueue_again(std::function<void()> task) {
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return;
    tasks_.push_back({std::move(task), /*fresh=*/false});
  }
  changed_.notify_one();
}

// A peer that has gone is an error of the call that notices it, not a signal.
void* WorkerPool::entry(void* self) {
  sigset_t pipe;
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
  static_cast<WorkerPool*>(self)->loop();
  return nullptr;
}

void WorkerPool::loop() {
  for (;;) {
    Task task;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return stopping_ || !tasks_.empty(); });
      if (tasks_.empty()) return;
      task = std::move(tasks_.front());
      tasks_.pop_front();
      if (task.fresh) --fresh_;
    }
    try {
      task.run();
    } catch (const std::bad_alloc&) {  // the task is lost, and what it held is free
    }
  }
}

}  // namespace kiln::http
