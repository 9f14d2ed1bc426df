#pragma once

#include <chrono>

#include "server/jobs/admission.h"
#include "server/jobs/job_control.h"
#include "server/jobs/job_limits.h"
#include "server/jobs/job_lookup.h"
#include "server/jobs/job_registry.h"
#include "server/jobs/job_run.h"
#include "server/jobs/job_runner.h"
#include "server/jobs/job_submit.h"
#include "server/jobs/job_transitions.h"
#include "server/jobs/notifier.h"

namespace kiln::jobs {

/// The parts of this room, put together. A job that was submitted is on the disk; it runs by
/// priority, fair share and age (JobQueue). Thread-safe; store failures are DatabaseError.
///
/// States: queued -> preparing -> running -> finalizing -> succeeded | failed | canceled, with
/// canceling in between; back to queued, with the next attempt, when the process ended in between.
/// That attempt goes on after the last pass that was done.
class JobService {
 public:
  /// Takes up the jobs that an earlier process left, clears away what it left besides, then starts
  /// the runner.
  JobService(Bakery, store::JobStore&, JobLimits);
  ~JobService();  ///< stop(), unless done
  JobService(const JobService&) = delete;
  JobService& operator=(const JobService&) = delete;

  const JobLookup& lookup() const { return lookup_; }
  JobSubmitter& submitter() { return submitter_; }
  JobControl& control() { return control_; }
  const Admission& admission() const { return admission_; }
  JobNotifier& notifier() { return notifier_; }
  base::CpuMeter& cpu_meter() { return runner_.cpu_meter(); }

  void begin_drain() { admission_.begin_drain(); }
  /// Stops running jobs, which go back to the queue for the next process.
  void stop();

 private:
  void recover();
  void clear_leftovers() const;

  const Bakery bakery_;
  store::JobStore& store_;
  const JobLimits limits_;
  JobRegistry registry_;
  JobNotifier notifier_;
  const JobTransitions transitions_;
  const JobLookup lookup_;
  Admission admission_;
  JobSubmitter submitter_;
  JobControl control_;
  JobRunner runner_;
};

}  // namespace kiln::jobs
