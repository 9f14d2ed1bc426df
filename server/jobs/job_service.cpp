#include "server/jobs/job_service.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/jobs/ids.h"
#include "server/jobs/job_changes.h"
#include "server/jobs/job_run.h"
#include "server/jobs/live_job.h"
#include "server/log.h"

namespace kiln::server {
namespace {

using proto::JobState;
using Durability = Database::Durability;

proto::Unexpected no_such_job(const std::string& id) {
  return proto::fail("not_found", "There is no job " + id + ".");
}

void log_state(const proto::Job& job) {
  nlohmann::json fields{
      {"job", job.id}, {"state", proto::to_string(job.state)}, {"attempt", job.attempt}};
  if (job.error) fields["code"] = job.error->code;
  log_line(job.state == JobState::kFailed ? LogLevel::kWarn : LogLevel::kInfo, "job", fields);
}

}  // namespace

JobService::JobService(const DataFolder& data, JobStore& store, const SceneStore& scenes,
                       baker::ThreadPool& pool, BakeFunction bake, JobLimits limits,
                       baker::ImportLimits import_limits)
    : data_(data),
      store_(store),
      scenes_(scenes),
      pool_(pool),
      bake_(std::move(bake)),
      limits_(limits),
      import_limits_(import_limits) {
  recover();
  for (std::uint32_t i = 0; i < limits_.running; ++i)
    runners_.emplace_back([this](std::stop_token stop) { runner_loop(stop); });
}

JobService::~JobService() {
  stop();
}

void JobService::add_live(const LivePtr& job) {
  live_[job->stored.job.id] = job;
  by_sequence_[job->stored.sequence] = job;
  if (job->stored.job.state == JobState::kQueued)
    queue_.insert({-job->stored.priority, job->stored.sequence});
}

// What the process before us did not finish. A job that was running when it died goes on, unless it
// has been there so often without getting further that it is the likely cause.
void JobService::recover() {
  for (StoredJob& stored : store_.unfinished()) {
    auto job = std::make_shared<LiveJob>(stored, store_.events_after(stored.job.id, 0));
    StoredJob& s = job->stored;
    if (s.job.state == JobState::kQueued) {
      add_live(job);
      continue;
    }
    if (s.job.state == JobState::kCanceling) {
      finish_job(store_, *job, JobState::kCancelled, std::nullopt, {});
    } else if (++s.crashes >= limits_.crashes) {
      finish_job(store_, *job, JobState::kFailed,
                 proto::Error{"worker_lost",
                              "The service ended " + std::to_string(s.crashes) +
                                  " times while it ran this job, at the same pass.",
                              {}},
                 {});
    } else {
      requeue_job(store_, *job);
      add_live(job);
    }
    log_state(s.job);
  }
}

proto::Expected<void> JobService::check_room() const {
  if (draining_)
    return proto::fail("draining", "The service is shutting down and takes no new jobs.");
  if (queue_.size() + submitting_ >= limits_.queued)
    return proto::fail("queue_full", "The queue is full (" + std::to_string(limits_.queued) +
                                         " jobs are waiting).");
  return {};
}

proto::Expected<void> JobService::accepting() const {
  const std::lock_guard lock(mutex_);
  return check_room();
}

proto::Expected<proto::Job> JobService::submit(const StoredScene& scene,
                                               const proto::BakeSettings& settings) {
  {
    const std::lock_guard lock(mutex_);
    if (auto room = check_room(); !room) return proto::Unexpected(room.error());
    ++submitting_;
  }
  StoredJob stored;
  stored.job.id = new_id("job_");
  stored.job.scene_sha256 = scene.key;
  stored.job.scene_bytes = scene.bytes;
  stored.job.settings = settings;
  stored.job.created_at = now_rfc3339();
  auto job = std::make_shared<LiveJob>(stored);
  const proto::Event first = job->state_event();
  try {
    job->stored.sequence = store_.insert(stored.job, first);
  } catch (...) {
    const std::lock_guard lock(mutex_);
    --submitting_;
    throw;
  }
  job->ring->push(first);
  {
    const std::lock_guard lock(mutex_);
    --submitting_;
    add_live(job);
  }
  changed_.notify_all();
  log_state(stored.job);
  return stored.job;
}

JobService::LivePtr JobService::live(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = live_.find(id);
  return found == live_.end() ? nullptr : found->second;
}

proto::Expected<proto::Job> JobService::get(const std::string& id) const {
  if (const LivePtr job = live(id)) {
    const std::lock_guard lock(job->mutex);
    return job->stored.job;
  }
  if (auto stored = store_.find(id)) return std::move(stored->job);
  return no_such_job(id);
}

proto::Expected<proto::Job> JobService::wait(const std::string& id,
                                             std::chrono::milliseconds time) const {
  {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, time, [&] { return waiters_released_ || !live_.contains(id); });
  }
  return get(id);
}

JobService::Page JobService::list(const JobFilter& filter) const {
  JobFilter one_more = filter;
  ++one_more.limit;
  std::vector<StoredJob> stored = store_.list(one_more);
  Page page;
  if (stored.size() > filter.limit) {
    stored.pop_back();
    page.next = stored.back().sequence;
  }
  for (auto& row : stored) page.jobs.push_back(std::move(row.job));
  return page;
}

proto::Expected<proto::Job> JobService::cancel(const std::string& id) {
  const LivePtr job = live(id);
  if (!job) return get(id);
  bool over = false;
  proto::Job result;
  {
    // Both locks: a runner that takes the job from the queue does so under mutex_.
    const std::scoped_lock locks(mutex_, job->mutex);
    StoredJob& s = job->stored;
    if (proto::is_terminal(s.job.state) || job->cancel_requested) return s.job;
    if (queue_.contains({-s.priority, s.sequence})) {
      finish_job(store_, *job, JobState::kCancelled, std::nullopt, {});
      queue_.erase({-s.priority, s.sequence});
      over = true;
    } else {
      change_state(store_, *job, JobState::kCanceling, Durability::kPromise);
    }
    job->cancel_requested = true;
    result = s.job;
  }
  job->stop.request_stop();
  notify(*job);
  if (over) retire(job);
  log_state(result);
  return result;
}

proto::Expected<void> JobService::remove(const std::string& id, bool force) {
  if (const LivePtr job = live(id)) {
    const auto refuse = [&] {
      return proto::fail("job_not_terminal",
                         "Job " + id + " is not over; cancel it first, or use ?force=true.");
    };
    if (!force) return refuse();
    if (auto canceled = cancel(id); !canceled) return proto::Unexpected(canceled.error());
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, std::chrono::seconds(10), [&] { return !live_.contains(id); }))
      return refuse();
  }
  if (!store_.find(id)) return no_such_job(id);
  store_.remove(id);
  data_.remove_job(id);
  log_line(LogLevel::kInfo, "job", {{"job", id}, {"state", "deleted"}});
  return {};
}

std::shared_ptr<const EventRing> JobService::events(const std::string& id) const {
  if (const LivePtr job = live(id)) return job->ring;
  if (!store_.find(id)) return nullptr;
  auto kept = store_.events_after(id, 0);
  const std::uint64_t last = kept.empty() ? 0 : kept.back().id;
  return std::make_shared<EventRing>(last, std::move(kept));
}

baker::Snapshot JobService::snapshot(const std::string& id) const {
  const LivePtr job = live(id);
  if (!job) return {};
  const std::lock_guard lock(job->mutex);
  return job->snapshot;
}

std::vector<proto::ResultFile> JobService::results(const std::string& id) const {
  return store_.results(id);
}

void JobService::on_event(std::function<void(const EventRing*)> hook) {
  const std::lock_guard lock(mutex_);
  event_hook_ = std::move(hook);
}

void JobService::notify(const LiveJob& job) {
  std::function<void(const EventRing*)> hook;
  {
    const std::lock_guard lock(mutex_);
    hook = event_hook_;
  }
  if (hook) hook(job.ring.get());
}

JobService::Counts JobService::counts() const {
  const std::lock_guard lock(mutex_);
  return {queue_.size(), running_};
}

void JobService::retire(const LivePtr& job) {
  {
    const std::lock_guard lock(mutex_);
    live_.erase(job->id);
    by_sequence_.erase(job->stored.sequence);
  }
  changed_.notify_all();
}

void JobService::begin_drain() {
  const std::lock_guard lock(mutex_);
  draining_ = true;
}

bool JobService::wait_idle(std::chrono::milliseconds time) const {
  std::unique_lock lock(mutex_);
  return changed_.wait_for(lock, time, [&] { return running_ == 0; });
}

void JobService::release_waiters() {
  {
    const std::lock_guard lock(mutex_);
    waiters_released_ = true;
  }
  changed_.notify_all();
}

void JobService::stop() {
  begin_drain();
  std::vector<LivePtr> all;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, job] : live_) all.push_back(job);
  }
  for (auto& runner : runners_) runner.request_stop();
  for (const auto& job : all) job->stop.request_stop();
  runners_.clear();  // joins
  release_waiters();
}

JobService::LivePtr JobService::next_job(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  const bool got = changed_.wait(lock, stop, [&] { return !draining_ && !queue_.empty(); });
  if (!got || stop.stop_requested()) return nullptr;
  const auto sequence = queue_.begin()->second;
  queue_.erase(queue_.begin());
  ++running_;
  return by_sequence_.at(sequence);
}

void JobService::runner_loop(std::stop_token stop) {
  while (const LivePtr job = next_job(stop)) {
    const RunContext context{
        data_, store_, scenes_, pool_, bake_, import_limits_, limits_.progress_interval, [&] {
          notify(*job);
        }};
    JobRun(context, *job).run(stop);
    {
      const std::lock_guard lock(mutex_);
      --running_;
    }
    settle(job);
  }
}

// After a run: the job is over, or waits for the next process.
void JobService::settle(const LivePtr& job) {
  const proto::Job result = [&] {
    const std::lock_guard lock(job->mutex);
    return job->stored.job;
  }();
  log_state(result);
  if (proto::is_terminal(result.state)) {
    retire(job);
  } else {
    changed_.notify_all();
  }
}

}  // namespace kiln::server
