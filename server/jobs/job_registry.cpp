#include "server/jobs/job_registry.h"

namespace kiln::jobs {

void JobRegistry::add(const Lock&, const JobPtr& job) {
  jobs_[job->id] = job;
  by_sequence_[job->stored().sequence] = job;
  if (job->job().state == proto::JobState::kQueued) queue_.insert(job->queue_entry());
  changed_.notify_all();
}

void JobRegistry::remove(const ActiveJob& job) {
  JobPtr last;  // goes without the lock
  {
    const Lock lock(mutex_);
    by_sequence_.erase(job.stored().sequence);
    if (const auto found = jobs_.find(job.id); found != jobs_.end()) {
      last = std::move(found->second);
      jobs_.erase(found);
    }
  }
  changed_.notify_all();
}

JobPtr JobRegistry::find(const Lock&, const std::string& id) const {
  const auto found = jobs_.find(id);
  return found == jobs_.end() ? nullptr : found->second;
}

JobPtr JobRegistry::at_sequence(const Lock&, std::int64_t sequence) const {
  return by_sequence_.at(sequence);
}

std::vector<JobPtr> JobRegistry::all() const {
  const Lock lock(mutex_);
  std::vector<JobPtr> all;
  for (const auto& [id, job] : jobs_) all.push_back(job);
  return all;
}

bool JobRegistry::wait(Lock& lock, const std::stop_token& stop,
                       const std::function<bool()>& ready) const {
  return changed_.wait(lock, stop, ready);
}

bool JobRegistry::wait(Lock& lock, std::chrono::milliseconds time,
                       const std::function<bool()>& ready) const {
  return changed_.wait_for(lock, time, ready);
}

void JobRegistry::wait_until_gone(Lock& lock, const std::string& id) const {
  changed_.wait(lock, [&] { return !jobs_.contains(id); });
}

void JobRegistry::wake() const {
  { const Lock lock(mutex_); }  // who has just looked waits by now
  changed_.notify_all();
}

}  // namespace kiln::jobs
