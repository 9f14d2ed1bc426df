#pragma once

#include <stop_token>
#include <thread>
#include <vector>

#include "server/base/cpu_meter.h"
#include "server/jobs/job_run.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// Runs jobs, some at a time, on threads of its own.
class JobRunner {
 public:
  JobRunner(const Bakery&, const JobLimits&, JobRegistry&, Admission&, const JobTransitions&,
            JobNotifier&, store::JobStore&);
  ~JobRunner();  ///< stop()
  JobRunner(const JobRunner&) = delete;
  JobRunner& operator=(const JobRunner&) = delete;

  void start();
  /// Stops running jobs, which go back to the queue for the next process, and joins the threads.
  void stop();
  base::CpuMeter& cpu_meter() { return cpu_meter_; }  ///< of the jobs that run

 private:
  void loop(const std::stop_token&);
  JobPtr wait_for_job(const std::stop_token&);
  bool run(const JobPtr&, const std::stop_token&);
  void put_back(const JobPtr&, const std::stop_token&);
  void settle(const JobPtr&);

  const Bakery& bakery_;
  const JobLimits& limits_;
  JobRegistry& registry_;
  Admission& admission_;
  const JobTransitions& transitions_;
  JobNotifier& notifier_;
  store::JobStore& store_;
  base::CpuMeter cpu_meter_;
  std::vector<std::jthread> threads_;
};

}  // namespace kiln::jobs
