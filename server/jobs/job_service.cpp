#include "server/jobs/job_service.h"

#include <algorithm>
#include <new>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/base/ids.h"
#include "server/base/log.h"
#include "server/jobs/job_changes.h"
#include "server/jobs/job_run.h"
#include "server/jobs/job_words.h"
#include "server/jobs/live_job.h"

namespace kiln::jobs {
namespace {

using proto::JobState;

}  // namespace

JobService::JobService(const data::DataFolder& data, store::JobStore& store,
                       const data::SceneStore& scenes, exec::ThreadPool& pool, BakeFunction bake,
                       JobLimits limits, files::ImportLimits import_limits, base::Metrics* metrics)
    : data_(data),
      store_(store),
      scenes_(scenes),
      pool_(pool),
      bake_(std::move(bake)),
      limits_(limits),
      import_limits_(import_limits),
      metrics_(metrics),
      memory_(limits_.memory ? limits_.memory
                             : std::make_shared<base::MemoryBudget>(limits_.memory_bytes)) {
  memory_->on_free([this] {
    { const std::lock_guard lock(mutex_); }  // a runner that has just looked is waiting by now
    changed_.notify_all();
  });
  recover();
  clear_leftovers();
  for (std::uint32_t i = 0; i < limits_.running; ++i)
    runners_.emplace_back([this](std::stop_token stop) { runner_loop(stop); });
}

JobService::~JobService() {
  stop();
  memory_->on_free({});
}

void JobService::add_live(const LivePtr& job) {
  live_[job->stored.job.id] = job;
  by_sequence_[job->stored.sequence] = job;
  if (job->stored.job.state == JobState::kQueued) queue_.insert(queue_entry(job->stored));
}

// What the process before us did not finish. A job that was running when it died goes on, unless it
// has been there so often without getting further that it is the likely cause.
void JobService::recover() {
  for (store::StoredJob& stored : store_.unfinished()) {
    auto job = std::make_shared<LiveJob>(stored, store_.events_after(stored.job.id, 0));
    store::StoredJob& s = job->stored;
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

// Folders of jobs that were deleted, or never stored, and checkpoints that nobody will ask for:
// what a process leaves that ends between two steps. None of these jobs is running yet.
void JobService::clear_leftovers() const {
  for (const std::string& id : data_.job_folders()) {
    const auto stored = store_.find(id);
    if (!stored) {
      log_line(base::LogLevel::kInfo, "leftover", {{"job", id}});
      data_.remove_job(id);
    } else if (stored->job.state == JobState::kSucceeded) {
      data_.remove_checkpoints(id);
    }
  }
}

proto::Expected<void> JobService::check_room(const std::string& tenant) const {
  if (draining_)
    return proto::fail("draining", "The service is shutting down and takes no new jobs.");
  if (queue_.size() + submitting_ >= limits_.queued)
    return proto::fail("queue_full", "The queue is full (" + std::to_string(limits_.queued) +
                                         " jobs are waiting).");
  if (limits_.tenant_queued > 0 && queue_.waiting(tenant) >= limits_.tenant_queued)
    return proto::fail("quota_exceeded", "As many jobs of this tenant are waiting as may (" +
                                             std::to_string(limits_.tenant_queued) + ").");
  if (limits_.tenant_bytes > 0 && store_.result_bytes(tenant) >= limits_.tenant_bytes)
    return proto::fail("quota_exceeded", "The results of this tenant's jobs have reached " +
                                             std::to_string(limits_.tenant_bytes) +
                                             " bytes: delete some.");
  return check_day(tenant);
}

proto::Expected<void> JobService::check_day(const std::string& tenant) const {
  if (limits_.tenant_texels == 0 && limits_.tenant_cpu_seconds == 0) return {};
  const auto today = store_.usage(tenant, base::now_rfc3339().substr(0, 10));
  const auto refuse = [](std::uint64_t limit, const char* what) {
    return proto::fail("quota_exceeded", "The tenant's jobs have taken their " +
                                             std::to_string(limit) + " " + what +
                                             " of this day (UTC).");
  };
  if (limits_.tenant_texels > 0 && today.texels >= limits_.tenant_texels)
    return refuse(limits_.tenant_texels, "texels");
  if (limits_.tenant_cpu_seconds > 0 && today.cpu_seconds >= double(limits_.tenant_cpu_seconds))
    return refuse(limits_.tenant_cpu_seconds, "processor seconds");
  return {};
}

JobService::Usage JobService::usage(const std::string& tenant) const {
  Usage usage;
  usage.day = base::now_rfc3339().substr(0, 10);
  usage.today = store_.usage(tenant, usage.day);
  usage.result_bytes = store_.result_bytes(tenant);
  const std::lock_guard lock(mutex_);
  usage.queued = queue_.waiting(tenant);
  usage.running = queue_.running(tenant);
  return usage;
}

proto::Expected<void> JobService::accepting(const std::string& tenant,
                                            const std::string& idempotency_key) const {
  if (!idempotency_key.empty() && store_.find_request(request_key(tenant, idempotency_key)))
    return {};
  const std::lock_guard lock(mutex_);
  return check_room(tenant);
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

std::size_t JobService::queue_position(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = live_.find(id);
  if (found == live_.end()) return 0;
  const std::lock_guard job_lock(found->second->mutex);
  return queue_.position(queue_entry(found->second->stored));
}

JobWatches::Watch JobService::watch(const std::string& id, std::optional<std::uint64_t> since,
                                    std::function<void()> moved) {
  auto watch = watches_.add(id, since, std::move(moved));
  // Now that the watch is on: a change before this look is seen by it, and one after it is told.
  const auto job = get(id);
  watches_.tell(id, job ? job->version : 0, !job || proto::is_terminal(job->state));
  return watch;
}

JobService::Page JobService::list(const store::JobFilter& filter) const {
  store::JobFilter one_more = filter;
  ++one_more.limit;
  std::vector<store::StoredJob> stored = store_.list(one_more);
  Page page;
  if (stored.size() > filter.limit) {
    stored.pop_back();
    page.next = stored.back().sequence;
  }
  for (auto& row : stored) page.jobs.push_back(std::move(row.job));
  return page;
}

std::vector<proto::Job> JobService::unfinished(const std::optional<std::string>& tenant) const {
  std::vector<LivePtr> all;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, job] : live_) all.push_back(job);
  }
  std::vector<proto::Job> jobs;
  for (const auto& job : all) {
    const std::lock_guard lock(job->mutex);
    const proto::Job& j = job->stored.job;
    if (!proto::is_terminal(j.state) && (!tenant || *tenant == j.tenant)) jobs.push_back(j);
  }
  return jobs;
}

std::shared_ptr<const base::EventRing> JobService::events(const std::string& id) const {
  if (const LivePtr job = live(id)) return job->ring;
  if (!store_.find(id)) return nullptr;
  auto kept = store_.events_after(id, 0);
  const std::uint64_t last = kept.empty() ? 0 : kept.back().id;
  return std::make_shared<base::EventRing>(last, std::move(kept));
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

void JobService::on_event(std::function<void(const base::EventRing*)> hook) {
  const std::lock_guard lock(mutex_);
  event_hook_ = std::move(hook);
}

void JobService::notify(const LiveJob& job) {
  std::function<void(const base::EventRing*)> hook;
  {
    const std::lock_guard lock(mutex_);
    hook = event_hook_;
  }
  tell_watchers(job);
  try {
    if (hook) hook(job.ring.get());
  } catch (const std::bad_alloc&) {  // streams learn of it with the next event
  }
}

void JobService::tell_watchers(const LiveJob& job) {
  const auto [version, over] = [&] {
    const std::lock_guard lock(job.mutex);
    const proto::Job& j = job.stored.job;
    return std::pair(j.version, proto::is_terminal(j.state));
  }();
  watches_.tell(job.id, version, over);
}

JobService::Counts JobService::counts() const {
  const std::lock_guard lock(mutex_);
  return {queue_.size(), queue_.running(), memory_->reserved()};
}

std::uint64_t JobService::memory_limit() const {
  const std::uint64_t all = memory_->for_bakes();
  return all == UINT64_MAX ? 0 : all;
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
  return changed_.wait_for(lock, time, [&] { return queue_.running() == 0; });
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
}

std::optional<JobQueue::Entry> JobService::take_job() {
  // One job may always run: whether it is too large by itself, it learns from admit(). But not
  // while it would only learn that imports have what it needs: on_free() tells when they are done.
  const bool alone = queue_.running() == 0 && memory_->imports_are_modest();
  auto next = queue_.take(limits_.tenant_running, alone ? UINT64_MAX : memory_->free_bytes());
  if (!next || next->bytes == 0 || next->bytes > memory_->for_bakes()) return next;
  if (memory_->reserve(by_sequence_.at(next->sequence)->id, next->bytes)) return next;
  queue_.release(next->tenant);  // an import came in between
  queue_.insert(*next);
  return std::nullopt;
}

JobService::LivePtr JobService::next_job(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  std::optional<JobQueue::Entry> next;
  changed_.wait(lock, stop, [&] {
    if (!draining_ && !stop.stop_requested()) next = take_job();
    return next.has_value();
  });
  return next ? by_sequence_.at(next->sequence) : nullptr;
}

Admission JobService::admit(const LiveJob& job, std::uint64_t bytes) {
  if (bytes > memory_->for_bakes()) return Admission::kNever;
  return memory_->reserve(job.id, bytes) ? Admission::kYes : Admission::kLater;
}

// Into the queue again, now that its size is known. A cancel that came meanwhile ends it.
void JobService::put_back(const LivePtr& job, const std::stop_token& stop) {
  const auto attempt = [&] {
    const std::scoped_lock locks(mutex_, job->mutex);
    if (job->cancel_requested) {
      finish_job(store_, *job, JobState::kCancelled, std::nullopt, {});
    } else {
      defer_job(store_, *job);
      queue_.insert(queue_entry(job->stored));
    }
  };
  for (;;) {
    try {
      attempt();
      break;
    } catch (const store::DatabaseError& e) {
      log_line(base::LogLevel::kError, "store", {{"job", job->id}, {"what", e.what()}});
      if (stop.stop_requested()) return;  // the next process runs the job again
      std::this_thread::sleep_for(std::chrono::milliseconds(500));
    } catch (const std::bad_alloc&) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  }
  notify(*job);
}

void JobService::runner_loop(std::stop_token stop) {
  while (const LivePtr job = next_job(stop)) {
    const bool deferred = run_job(job, stop);
    {
      const std::lock_guard lock(mutex_);
      queue_.release(job->stored.job.tenant);
      memory_->release(job->id);
    }
    if (deferred) put_back(job, stop);
    settle(job);
  }
}

// Whether the job has to be queued again, for memory.
bool JobService::run_job(const LivePtr& job, std::stop_token stop) {
  const RunContext context{data_,
                           store_,
                           scenes_,
                           pool_,
                           bake_,
                           import_limits_,
                           limits_,
                           metrics_,
                           [&](std::uint64_t bytes) { return admit(*job, bytes); },
                           memory_->for_bakes(),
                           [&] { notify(*job); }};
  const base::CpuMeter::Run cpu(cpu_meter_);
  JobRun run(context, *job);
  const auto end = run.run(std::move(stop));
  try {
    store_.add_usage(job->stored.job.tenant, base::now_rfc3339().substr(0, 10),
                     {run.texels(), cpu.seconds()});
  } catch (const store::DatabaseError& e) {
    log_line(base::LogLevel::kError, "store", {{"job", job->id}, {"what", e.what()}});
  }
  return end == JobRun::End::kDeferred;
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

}  // namespace kiln::jobs
