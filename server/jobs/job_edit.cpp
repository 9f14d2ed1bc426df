#include <nlohmann/json.hpp>

#include "server/base/log.h"
#include "server/jobs/job_changes.h"
#include "server/jobs/job_service.h"
#include "server/jobs/job_words.h"
#include "server/jobs/live_job.h"

/// What clients do to jobs that are there.
namespace kiln::jobs {
namespace {

using proto::JobState;
using Durability = store::Database::Durability;

std::size_t labels_after(const proto::Labels& labels, const proto::JobPatch& patch) {
  std::size_t count = labels.size();
  for (const auto& [name, value] : patch.labels) {
    if (value && !labels.contains(name)) ++count;
    if (!value && labels.contains(name)) --count;
  }
  return count;
}

proto::Expected<void> check_patch(const proto::Job& job, const proto::JobPatch& patch,
                                  const std::function<bool(std::uint64_t)>& allowed) {
  if (!allowed(job.version))
    return proto::fail("precondition_failed",
                       "The job has changed: its version is " + std::to_string(job.version) + ".");
  if (labels_after(job.labels, patch) > proto::JobOptions::kMaxLabels)
    return proto::fail(
        "invalid_request",
        "A job has at most " + std::to_string(proto::JobOptions::kMaxLabels) + " labels.",
        "request", "/labels");
  return {};
}

}  // namespace

proto::Expected<proto::Job> JobService::cancel(const std::string& id, CancelMode mode) {
  const LivePtr job = live(id);
  if (!job) return get(id);
  bool over = false;
  proto::Job result;
  {
    // Both locks: a runner that takes the job from the queue does so under mutex_.
    const std::scoped_lock locks(mutex_, job->mutex);
    store::StoredJob& s = job->stored;
    if (proto::is_terminal(s.job.state)) return s.job;
    if (!job->cancel_requested) {
      if (queue_.contains(queue_entry(s))) {
        finish_job(store_, *job, JobState::kCancelled, std::nullopt, {});
        queue_.erase(queue_entry(s));
        over = true;
      } else {
        change_state(store_, *job, JobState::kCanceling, Durability::kPromise);
      }
    }
    job->cancel_requested = true;
    result = s.job;
  }
  (mode == CancelMode::kDrain ? job->enough : job->stop).request_stop();
  notify(*job);
  if (over) retire(job);
  log_state(result);
  return result;
}

proto::Expected<JobService::LivePtr> JobService::find_over(
    const std::string& id, std::unique_lock<std::mutex>& lock) const {
  if (const auto found = live_.find(id); found != live_.end()) {
    {
      const std::lock_guard job_lock(found->second->mutex);
      if (!proto::is_terminal(found->second->stored.job.state)) return nullptr;
    }
    changed_.wait(lock, [&] { return !live_.contains(id); });
  }
  auto stored = store_.find(id);
  if (!stored) return no_such_job(id);
  return std::make_shared<LiveJob>(std::move(*stored), store_.events_after(id, 0));
}

proto::Expected<proto::Job> JobService::retry(const std::string& id, RetryFrom from) {
  std::unique_lock lock(mutex_);
  const auto job = find_over(id, lock);
  if (!job) return proto::Unexpected(job.error());
  if (!*job || (*job)->stored.job.state == JobState::kSucceeded)
    return proto::fail("job_not_retryable",
                       "Only a job that failed or was canceled can be run again.");
  if (auto room = check_room((*job)->stored.job.tenant); !room)
    return proto::Unexpected(room.error());
  if (from == RetryFrom::kStart) data_.remove_checkpoints(id);
  restart_job(store_, **job);
  proto::Job result = (*job)->stored.job;
  add_live(*job);
  lock.unlock();
  changed_.notify_all();
  log_state(result);
  return result;
}

proto::Expected<proto::Job> JobService::patch(const std::string& id, const proto::JobPatch& patch,
                                              const std::function<bool(std::uint64_t)>& allowed) {
  std::unique_lock lock(mutex_);
  auto over = find_over(id, lock);
  if (!over) return proto::Unexpected(over.error());
  const LivePtr job = *over ? *over : live_.at(id);
  proto::Job result;
  {
    const std::lock_guard job_lock(job->mutex);
    store::StoredJob& s = job->stored;
    if (auto ok = check_patch(s.job, patch, allowed); !ok) return proto::Unexpected(ok.error());
    const JobQueue::Entry before = queue_entry(s);
    patch_job(store_, *job, patch);
    if (queue_.erase(before)) queue_.insert(queue_entry(s));
    result = s.job;
  }
  lock.unlock();
  changed_.notify_all();
  tell_watchers(*job);
  return result;
}

proto::Expected<void> JobService::remove(const std::string& id, bool force) {
  constexpr std::chrono::seconds kPatience{10};
  const auto refuse = [&] {
    return proto::fail("job_not_terminal",
                       "Job " + id + " is not over; cancel it first, or use ?force=true.");
  };
  const LivePtr job = live(id);
  // One that is over and only has to be put away, which others have been told of already, is waited
  // for below.
  const auto is_over = [&] {
    const std::lock_guard lock(job->mutex);
    return proto::is_terminal(job->stored.job.state);
  };
  if (job && !is_over()) {
    if (!force) return refuse();
    if (auto canceled = cancel(id); !canceled) return proto::Unexpected(canceled.error());
  }
  {
    // To the end under the lock: a retry in between would queue a job that is gone.
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, kPatience, [&] { return !live_.contains(id); })) return refuse();
    if (!store_.find(id)) return no_such_job(id);
    store_.remove(id);
  }
  data_.remove_job(id);
  log_line(base::LogLevel::kInfo, "job", {{"job", id}, {"state", "deleted"}});
  return {};
}

}  // namespace kiln::jobs
