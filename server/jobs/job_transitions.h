#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "proto/event.h"
#include "proto/expected.h"
#include "proto/manifest.h"
#include "server/jobs/active_job.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// Every way in which a job can change: the only door to its fields. A transition stores the change
/// and its events in one transaction, then shows both to readers; the version grows. When the store
/// throws (DatabaseError), the job is as it was. The caller holds the job's mutex. The functions
/// named note_... change memory only: what they note is stored with the next transition.
class JobTransitions {
 public:
  explicit JobTransitions(store::JobStore& store) : store_(store) {}

  /// Stores a new job that waits, and gives it its sequence.
  void submit(ActiveJob&, const std::optional<store::IdempotencyKey>&) const;
  /// Stores a new job that is over at once, with the results of an identical bake.
  void submit_cached(ActiveJob&, const proto::Job& original, const std::vector<proto::ResultFile>&,
                     const std::optional<store::IdempotencyKey>&) const;

  /// A runner took the job from the queue: kPreparing.
  void start(ActiveJob&) const;
  /// The bake begins a stage. The state follows from it, unless the job is being canceled.
  void begin_stage(ActiveJob&, const std::string& stage) const;
  /// A pass is done: the process that ended attempts before did not end by this job's fault.
  void complete_pass(ActiveJob&, const proto::PassReport&) const;
  /// Adds one event about the job as it is now.
  void add_event(ActiveJob&, const char* type, const nlohmann::json& data) const;
  void note_progress(ActiveJob&, const proto::JobProgress&) const;
  void note_memory_estimate(ActiveJob&, std::uint64_t bytes) const;
  /// The job will be canceled, whatever its bake answers: see cancel().
  void note_cancel(ActiveJob&) const;

  /// A job that runs turns to kCanceling.
  void cancel(ActiveJob&) const;
  /// The job is over: result.ready when there are files, job.state, job.end.
  void finish(ActiveJob&, proto::JobState, std::optional<proto::Error>,
              const std::vector<proto::ResultFile>&) const;
  /// A job that ran goes back to the queue, for the next attempt.
  void requeue(ActiveJob&) const;
  /// The same for a job whose process ended while it ran. With `limit` such ends in a row it fails
  /// instead, as `worker_lost`.
  void recover(ActiveJob&, std::uint32_t limit) const;
  /// The same for a job that was over; its results are forgotten.
  void restart(ActiveJob&) const;
  /// A job goes back to the queue as the same attempt, since there is no room for its memory now.
  void defer(ActiveJob&) const;

  /// Changes priority, labels and time to live. Adds no event: events are about the bake.
  void patch(ActiveJob&, const proto::JobPatch&) const;

 private:
  using Events = std::vector<proto::Event>;
  /// Applies `change` to the job and hands the events to `keep`; undoes it when that throws.
  template <class Change, class Keep>
  void apply(ActiveJob&, const Change& change, const Keep& keep) const;
  void enter(ActiveJob&, proto::JobState, store::Database::Durability) const;

  store::JobStore& store_;
};

/// Repeats `attempt` while the store can't take it (a full disk) or memory is short: what it stores
/// was promised. Returns false when `stop` came first; then the next process runs the job again.
bool keep_trying(const std::string& job, const std::stop_token& stop,
                 const std::function<void()>& attempt);

}  // namespace kiln::jobs
