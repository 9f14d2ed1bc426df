#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "proto/expected.h"
#include "proto/job.h"
#include "server/data/data_folder.h"
#include "server/jobs/admission.h"
#include "server/jobs/job_lookup.h"
#include "server/jobs/job_transitions.h"
#include "server/jobs/notifier.h"

namespace kiln::jobs {

enum class CancelMode {
  kNow,    ///< as soon as possible, without a result
  kDrain,  ///< the light of the passes that are done becomes the result
};

enum class RetryFrom { kCheckpoint, kStart };

/// Changes jobs on behalf of clients. Thread-safe; throws DatabaseError.
class JobControl {
 public:
  JobControl(const data::DataFolder&, store::JobStore&, JobRegistry&, const JobLookup&,
             const Admission&, const JobTransitions&, JobNotifier&);

  /// A queued job is over at once; a running one turns to canceling. One that is over stays as it
  /// is. Errors: `not_found`.
  proto::Expected<proto::Job> cancel(const std::string& id, CancelMode = CancelMode::kNow);
  /// Queues a job that failed or was canceled again, as its next attempt.
  /// Errors: `not_found`, `job_not_retryable`, `queue_full`, `draining`, `quota_exceeded`.
  proto::Expected<proto::Job> retry(const std::string& id, RetryFrom);
  /// Changes a job's options, if `allowed` says yes to its version.
  /// Errors: `not_found`, `precondition_failed`, `invalid_request` (too many labels).
  proto::Expected<proto::Job> patch(const std::string& id, const proto::JobPatch&,
                                    const std::function<bool(std::uint64_t version)>& allowed);
  /// Deletes a job that is over, with its files. `force` cancels it first.
  /// Errors: `not_found`, `job_not_terminal`.
  proto::Expected<void> remove(const std::string& id, bool force);

 private:
  /// Returns a job that is over, as of the store, once its runner has let go of it. Null: the job
  /// is not over.
  proto::Expected<JobPtr> find_over(JobRegistry::Lock&, const std::string& id) const;

  const data::DataFolder& data_;
  store::JobStore& store_;
  JobRegistry& registry_;
  const JobLookup& lookup_;
  const Admission& admission_;
  const JobTransitions& transitions_;
  JobNotifier& notifier_;
};

}  // namespace kiln::jobs
