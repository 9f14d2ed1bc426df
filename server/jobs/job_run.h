#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>

#include "baker/bake.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "server/jobs/admission.h"
#include "server/jobs/job_limits.h"
#include "server/jobs/job_log.h"
#include "server/jobs/job_transitions.h"
#include "server/jobs/notifier.h"

namespace kiln::base {
class Metrics;
}

namespace kiln::jobs {

struct JobInput : baker::BakeInput {
  std::string job;  ///< id of the job
};

/// baker::bake, or a test's stand-in.
using BakeFunction = std::function<proto::Expected<proto::Manifest>(
    const JobInput&, exec::ThreadPool&, std::stop_token, baker::BakeObserver&)>;

/// The parts that bakes are made with.
struct Bakery {
  const data::DataFolder& data;
  const data::SceneStore& scenes;
  exec::ThreadPool& pool;
  BakeFunction bake;
  files::ImportLimits import_limits;
  base::Metrics* metrics = nullptr;  ///< null: nobody counts
};

/// One attempt at one job: calls the bake, turns what it observes into events, and stores how it
/// ended. Whatever the bake throws fails this job only.
class JobRun final : public baker::BakeObserver {
 public:
  JobRun(const Bakery&, const JobLimits&, Admission&, const JobTransitions&, JobNotifier&,
         ActiveJob&);

  enum class End {
    kConcluded,  ///< the job is over, or queued because `service_stop` was requested
    kDeferred,   ///< it has to wait for memory: the caller queues it
  };
  End run(std::stop_token service_stop);
  std::uint64_t texels() const { return texels_; }  ///< whose light was computed

  void on_stage(const std::string& name) override;
  void on_resume(std::uint32_t passes) override;
  void on_resume_within(const std::string& pass, double share) override;
  void on_progress(const proto::JobProgress&) override;
  void on_pass(const proto::PassReport&) override;
  void on_snapshot(baker::Snapshot) override;
  void on_warning(const proto::Warning&) override;

 private:
  struct Outcome {
    std::optional<proto::Error> error;
    std::vector<proto::ResultFile> files;
  };
  Outcome bake();
  Outcome bake_scene(const proto::Job&);
  JobInput input_for(const proto::Job&, const data::StoredScene&);
  proto::Expected<void> reserve(std::uint64_t bytes);
  proto::Expected<std::vector<proto::ResultFile>> collect(const proto::Manifest&) const;
  proto::Expected<void> copy_log(const std::filesystem::path& to) const;
  void conclude(Outcome, const std::stop_token& service_stop);
  void store_end(Outcome&, const std::stop_token& service_stop);
  void report_resumed(const std::string& text);
  /// Runs `change` under the job's mutex; a store failure is logged, since the bake can go on.
  void record(const std::function<void()>& change);

  const Bakery& bakery_;
  const JobLimits& limits_;
  Admission& admission_;
  const JobTransitions& transitions_;
  JobNotifier& notifier_;
  ActiveJob& job_;
  const JobLog log_;
  std::atomic<bool> timed_out_{false};
  std::atomic<std::uint64_t> texels_{0};
  bool deferred_ = false;
  std::chrono::steady_clock::time_point last_progress_{};  ///< guarded by job_.mutex
};

}  // namespace kiln::jobs
