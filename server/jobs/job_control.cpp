#include "server/jobs/job_control.h"

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/base/log.h"
#include "server/jobs/job_messages.h"

namespace kiln::jobs {
namespace {

using proto::JobState;

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

JobControl::JobControl(const data::DataFolder& data, store::JobStore& store, JobRegistry& registry,
                       const JobLookup& lookup, const Admission& admission,
                       const JobTransitions& transitions, JobNotifier& notifier)
    : data_(data),
      store_(store),
      registry_(registry),
      lookup_(lookup),
      admission_(admission),
      transitions_(transitions),
      notifier_(notifier) {}

proto::Expected<proto::Job> JobControl::cancel(const std::string& id, CancelMode mode) {
  const JobPtr job = registry_.find(id);
  if (!job) return lookup_.get(id);
  bool over = false;
  proto::Job result;
  {
    // Both locks: a runner takes the job from the queue under the registry's.
    const JobRegistry::Lock lock = registry_.lock();
    const std::lock_guard job_lock(job->mutex);
    if (proto::is_terminal(job->job().state)) return job->job();
    if (!job->cancel_requested()) {
      JobQueue& queue = registry_.queue(lock);
      if (const auto waiting = job->queue_entry(); queue.contains(waiting)) {
        transitions_.finish(*job, JobState::kCanceled, std::nullopt, {});
        queue.erase(waiting);
        over = true;
      } else {
        transitions_.cancel(*job);
      }
    }
    transitions_.note_cancel(*job);
    result = job->job();
  }
  (mode == CancelMode::kDrain ? job->finish_early : job->stop).request_stop();
  notifier_.notify(*job);
  if (over) registry_.remove(*job);
  log_state(result);
  return result;
}

proto::Expected<JobPtr> JobControl::find_over(JobRegistry::Lock& lock,
                                              const std::string& id) const {
  if (const JobPtr active = registry_.find(lock, id)) {
    if (!proto::is_terminal(active->copy().state)) return nullptr;
    registry_.wait_until_gone(lock, id);
  }
  auto stored = store_.find(id);
  if (!stored) return no_such_job(id);
  return std::make_shared<ActiveJob>(std::move(*stored), store_.events_after(id, 0));
}

proto::Expected<proto::Job> JobControl::retry(const std::string& id, RetryFrom from) {
  JobRegistry::Lock lock = registry_.lock();
  const auto over = find_over(lock, id);
  if (!over) return proto::Unexpected(over.error());
  const JobPtr& job = *over;
  if (!job || job->copy().state == JobState::kSucceeded)
    return proto::fail("job_not_retryable",
                       "Only a job that failed or was canceled can be run again.");
  if (auto room = admission_.check(lock, job->tenant); !room)
    return proto::Unexpected(room.error());
  if (from == RetryFrom::kStart) data_.remove_checkpoints(id);
  proto::Job result;
  {
    const std::lock_guard job_lock(job->mutex);
    transitions_.restart(*job);
    registry_.add(lock, job);
    result = job->job();
  }
  lock.unlock();
  log_state(result);
  return result;
}

proto::Expected<proto::Job> JobControl::patch(const std::string& id, const proto::JobPatch& patch,
                                              const std::function<bool(std::uint64_t)>& allowed) {
  JobRegistry::Lock lock = registry_.lock();
  const auto over = find_over(lock, id);
  if (!over) return proto::Unexpected(over.error());
  const JobPtr job = *over ? *over : registry_.find(lock, id);
  proto::Job result;
  {
    const std::lock_guard job_lock(job->mutex);
    if (auto ok = check_patch(job->job(), patch, allowed); !ok)
      return proto::Unexpected(ok.error());
    const JobQueue::Entry before = job->queue_entry();
    transitions_.patch(*job, patch);
    JobQueue& queue = registry_.queue(lock);
    if (queue.erase(before)) queue.insert(job->queue_entry());
    result = job->job();
  }
  lock.unlock();
  registry_.wake();
  notifier_.notify_watchers(*job);
  return result;
}

proto::Expected<void> JobControl::remove(const std::string& id, bool force) {
  constexpr std::chrono::seconds kPatience{10};
  const auto refuse = [&] {
    return proto::fail("job_not_terminal",
                       "Job " + id + " is not over; cancel it first, or use ?force=true.");
  };
  // A job that is over already, and which its runner is about to let go of, is waited for below.
  const JobPtr job = registry_.find(id);
  if (job && !proto::is_terminal(job->copy().state)) {
    if (!force) return refuse();
    if (auto canceled = cancel(id); !canceled) return proto::Unexpected(canceled.error());
  }
  {
    // To the end under the lock: a retry in between would queue a job that is gone.
    JobRegistry::Lock lock = registry_.lock();
    if (!registry_.wait(lock, kPatience, [&] { return !registry_.find(lock, id); }))
      return refuse();
    if (!store_.find(id)) return no_such_job(id);
    store_.remove(id);
  }
  data_.remove_job(id);
  log_line(base::LogLevel::kInfo, "job", {{"job", id}, {"state", "deleted"}});
  return {};
}

}  // namespace kiln::jobs
