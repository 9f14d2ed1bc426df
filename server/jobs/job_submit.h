#pragma once

#include <mutex>
#include <optional>
#include <set>
#include <string>

#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "proto/job.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "server/jobs/admission.h"
#include "server/jobs/job_lookup.h"
#include "server/jobs/job_transitions.h"

namespace kiln::jobs {

/// A job as a client asks for it.
struct Submission {
  data::StoredScene scene;
  proto::BakeSettings settings;
  proto::JobOptions options;
  std::string tenant;
  std::string idempotency_key;  ///< the client's name for this request; "": none
};

/// Takes new jobs. Thread-safe; throws DatabaseError.
class JobSubmitter {
 public:
  JobSubmitter(const data::DataFolder&, store::JobStore&, const JobLimits&, JobRegistry&,
               const JobLookup&, Admission&, const JobTransitions&);

  /// Whether submit() would take a job of this tenant now: worth knowing before an upload is read.
  /// It would when the request of this idempotency key was answered before: that takes no room.
  /// Errors: `queue_full`, `draining`, `quota_exceeded`.
  proto::Expected<void> accepting(const std::string& tenant,
                                  const std::string& idempotency_key = {}) const;

  struct Submitted {
    proto::Job job;
    bool replayed = false;  ///< the job of an earlier request with the same idempotency key
  };
  /// Queues a job, which is on the disk when this returns. With options.dedupe, an identical bake
  /// that succeeded makes it a job that is over at once.
  /// Errors: `queue_full`, `draining`, `quota_exceeded`, `idempotency_in_progress`,
  /// `idempotency_mismatch`.
  proto::Expected<Submitted> submit(const Submission&);

 private:
  class KeyInUse;
  std::optional<proto::Expected<Submitted>> replay(const store::IdempotencyKey&) const;
  std::optional<proto::Job> submit_cached(const store::StoredJob&,
                                          const std::optional<store::IdempotencyKey>&) const;
  proto::Expected<proto::Job> enqueue(const store::StoredJob&,
                                      const std::optional<store::IdempotencyKey>&);

  const data::DataFolder& data_;
  store::JobStore& store_;
  const JobLimits& limits_;
  JobRegistry& registry_;
  const JobLookup& lookup_;
  Admission& admission_;
  const JobTransitions& transitions_;
  std::mutex mutex_;
  std::set<std::string> keys_in_use_;  ///< of requests being answered; guarded by mutex_
};

}  // namespace kiln::jobs
