#include "server/jobs/notifier.h"

#include <new>
#include <utility>

namespace kiln::jobs {

void JobNotifier::on_event(EventHook hook) {
  const std::lock_guard lock(mutex_);
  hook_ = std::move(hook);
}

void JobNotifier::notify(const ActiveJob& job) {
  const EventHook hook = [&] {
    const std::lock_guard lock(mutex_);
    return hook_;
  }();
  notify_watchers(job);
  try {
    if (hook) hook(job.ring.get());
  } catch (const std::bad_alloc&) {  // streams learn of it with the next event
  }
}

void JobNotifier::notify_watchers(const ActiveJob& job) {
  const auto [version, over] = [&] {
    const std::lock_guard lock(job.mutex);
    return std::pair(job.job().version, proto::is_terminal(job.job().state));
  }();
  watches_.tell(job.id, version, over);
}

}  // namespace kiln::jobs
