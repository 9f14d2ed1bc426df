#pragma once

#include <functional>
#include <mutex>

#include "server/jobs/active_job.h"
#include "server/jobs/job_watches.h"

namespace kiln::jobs {

/// Tells streams and watchers that a job has changed. Thread-safe; calls them with no lock held.
class JobNotifier {
 public:
  using EventHook = std::function<void(const base::EventRing*)>;

  /// `hook` is called after each new event, from any thread.
  void on_event(EventHook hook);
  JobWatches& watches() { return watches_; }

  /// The job has new events: calls the hook, and the watchers that wait for this change.
  void notify(const ActiveJob&);
  /// The job has changed without an event: calls the watchers.
  void notify_watchers(const ActiveJob&);

 private:
  JobWatches watches_;
  std::mutex mutex_;
  EventHook hook_;  ///< guarded by mutex_
};

}  // namespace kiln::jobs
