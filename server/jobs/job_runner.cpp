#include "server/jobs/job_runner.h"

#include "server/base/clock.h"
#include "server/jobs/job_messages.h"

namespace kiln::jobs {

JobRunner::JobRunner(const Bakery& bakery, const JobLimits& limits, JobRegistry& registry,
                     Admission& admission, const JobTransitions& transitions, JobNotifier& notifier,
                     store::JobStore& store)
    : bakery_(bakery),
      limits_(limits),
      registry_(registry),
      admission_(admission),
      transitions_(transitions),
      notifier_(notifier),
      store_(store) {}

JobRunner::~JobRunner() {
  stop();
}

void JobRunner::start() {
  for (std::uint32_t i = 0; i < limits_.running; ++i)
    threads_.emplace_back([this](const std::stop_token& stop) { loop(stop); });
}

void JobRunner::stop() {
  // The threads first: a run that is stopped looks whether the service is what stops it.
  for (auto& thread : threads_) thread.request_stop();
  for (const JobPtr& job : registry_.all()) job->stop.request_stop();
  threads_.clear();  // joins
}

void JobRunner::loop(const std::stop_token& stop) {
  while (const JobPtr job = wait_for_job(stop)) {
    const bool deferred = run(job, stop);
    admission_.release(*job);
    if (deferred) put_back(job, stop);
    settle(job);
  }
}

JobPtr JobRunner::wait_for_job(const std::stop_token& stop) {
  JobRegistry::Lock lock = registry_.lock();
  JobPtr job;
  registry_.wait(lock, stop, [&] {
    if (!stop.stop_requested()) job = admission_.take_next(lock);
    return job != nullptr;
  });
  return job;
}

// Returns whether the job has to be queued again, for memory.
bool JobRunner::run(const JobPtr& job, const std::stop_token& stop) {
  const base::CpuMeter::Run cpu(cpu_meter_);
  JobRun run(bakery_, limits_, admission_, transitions_, notifier_, *job);
  const JobRun::End end = run.run(stop);
  try {
    store_.add_usage(job->tenant, base::today(), {run.texels(), cpu.seconds()});
  } catch (const store::DatabaseError& e) {
    log_store_failure(job->id, e.what());
  }
  return end == JobRun::End::kDeferred;
}

// Queues the job again, now that its size is known. A cancel that came meanwhile ends it.
void JobRunner::put_back(const JobPtr& job, const std::stop_token& stop) {
  const auto attempt = [&] {
    const JobRegistry::Lock lock = registry_.lock();
    const std::lock_guard job_lock(job->mutex);
    if (job->cancel_requested()) {
      transitions_.finish(*job, proto::JobState::kCanceled, std::nullopt, {});
    } else {
      transitions_.defer(*job);
      registry_.queue(lock).insert(job->queue_entry());
    }
  };
  if (keep_trying(job->id, stop, attempt)) notifier_.notify(*job);
}

// After a run the job is over, or waits for its next attempt, perhaps by the next process.
void JobRunner::settle(const JobPtr& job) {
  const proto::Job result = job->copy();
  log_state(result);
  if (proto::is_terminal(result.state))
    registry_.remove(*job);
  else
    registry_.wake();
}

}  // namespace kiln::jobs
