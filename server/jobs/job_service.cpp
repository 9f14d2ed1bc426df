#include "server/jobs/job_service.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "server/base/log.h"
#include "server/jobs/job_messages.h"

namespace kiln::jobs {

using proto::JobState;

JobService::JobService(Bakery bakery, store::JobStore& store, JobLimits limits)
    : bakery_(std::move(bakery)),
      store_(store),
      limits_(std::move(limits)),
      transitions_(store),
      lookup_(registry_, store, notifier_.watches()),
      admission_(limits_, registry_, store),
      submitter_(bakery_.data, store, limits_, registry_, lookup_, admission_, transitions_),
      control_(bakery_.data, store, registry_, lookup_, admission_, transitions_, notifier_),
      runner_(bakery_, limits_, registry_, admission_, transitions_, notifier_, store) {
  recover();
  clear_leftovers();
  runner_.start();
}

JobService::~JobService() {
  stop();
}

void JobService::stop() {
  begin_drain();
  runner_.stop();
}

// Takes up what the process before this one did not finish. A job that was running when it ended
// goes on, unless it has been there so often without getting further that it is the likely cause.
void JobService::recover() {
  const JobRegistry::Lock lock = registry_.lock();
  for (store::StoredJob& stored : store_.unfinished()) {
    auto kept = store_.events_after(stored.job.id, 0);
    const auto job = std::make_shared<ActiveJob>(std::move(stored), std::move(kept));
    const std::lock_guard job_lock(job->mutex);
    if (job->job().state != JobState::kQueued) {
      if (job->job().state == JobState::kCanceling)
        transitions_.finish(*job, JobState::kCanceled, std::nullopt, {});
      else
        transitions_.recover(*job, limits_.crashes);
      log_state(job->job());
    }
    if (!proto::is_terminal(job->job().state)) registry_.add(lock, job);
  }
}

// Removes what a process leaves that ends between two steps: folders of jobs that were deleted, or
// never stored, and checkpoints that nobody will ask for. None of these jobs is running yet.
void JobService::clear_leftovers() const {
  for (const std::string& id : bakery_.data.job_folders()) {
    const auto stored = store_.find(id);
    if (!stored) {
      log_line(base::LogLevel::kInfo, "leftover", {{"job", id}});
      bakery_.data.remove_job(id);
    } else if (stored->job.state == JobState::kSucceeded) {
      bakery_.data.remove_checkpoints(id);
    }
  }
}

}  // namespace kiln::jobs
