#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <stop_token>
#include <string>
#include <vector>

#include "server/jobs/active_job.h"
#include "server/jobs/job_queue.h"

namespace kiln::jobs {

/// The jobs that are not over, and the line of those that wait. Thread-safe: functions that take a
/// Lock want the one that lock() returned, so that several of them make one step. Where a job's
/// mutex is needed too, it is taken after this lock.
class JobRegistry {
 public:
  using Lock = std::unique_lock<std::mutex>;

  Lock lock() const { return Lock(mutex_); }

  /// Adds a job; one that is queued joins the line. Wakes those that wait.
  void add(const Lock&, const JobPtr&);
  /// Forgets a job that is over. Wakes those that wait.
  void remove(const ActiveJob&);
  JobPtr find(const Lock&, const std::string& id) const;  ///< null: it is over, or there is none
  JobPtr find(const std::string& id) const { return find(lock(), id); }
  /// The job at this place of the order of submission. It has to be there.
  JobPtr at_sequence(const Lock&, std::int64_t sequence) const;
  std::vector<JobPtr> all() const;

  JobQueue& queue(const Lock&) { return queue_; }
  const JobQueue& queue(const Lock&) const { return queue_; }

  /// Waits until `ready` holds, which is asked again after each wake(); false: stopped first.
  bool wait(Lock&, const std::stop_token&, const std::function<bool()>& ready) const;
  /// The same; false: the time was up first.
  bool wait(Lock&, std::chrono::milliseconds, const std::function<bool()>& ready) const;
  /// Waits until this job has been removed.
  void wait_until_gone(Lock&, const std::string& id) const;
  /// Something that somebody may wait for has changed.
  void wake() const;

 private:
  mutable std::mutex mutex_;  ///< guards what follows
  mutable std::condition_variable_any changed_;
  std::map<std::string, JobPtr> jobs_;
  std::map<std::int64_t, JobPtr> by_sequence_;
  JobQueue queue_;
};

}  // namespace kiln::jobs
