#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>

#include "baker/bake.h"
#include "server/jobs/job_changes.h"
#include "server/jobs/job_log.h"
#include "server/jobs/job_service.h"

namespace kiln::jobs {

/// Whether a bake of so many bytes may go on.
enum class Admission {
  kYes,
  kLater,  ///< beside those that run now there is no room for it
  kNever,  ///< it is over the budget by itself
};

/// What a run needs of its service.
struct RunContext {
  const data::DataFolder& data;
  store::JobStore& store;
  const data::SceneStore& scenes;
  exec::ThreadPool& pool;
  const BakeFunction& bake;
  const files::ImportLimits& import_limits;
  const JobLimits& limits;
  base::Metrics* metrics;  ///< null: nobody counts
  std::function<Admission(std::uint64_t bytes)> admit;
  std::uint64_t memory_bytes;    ///< of all bakes
  std::function<void()> notify;  ///< after each new event
};

/// One attempt at one job: calls the bake, turns what it observes into events, and stores how it
/// ended. Whatever the bake throws fails this job only.
class JobRun final : public baker::BakeObserver {
 public:
  JobRun(const RunContext& context, LiveJob& job)
      : context_(context), job_(job), log_(JobLog::path(context.data, job.id)) {}

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
  proto::Expected<void> reserve(std::uint64_t bytes);
  proto::Expected<std::vector<proto::ResultFile>> collect(const proto::Manifest&) const;
  proto::Expected<void> copy_log(const std::filesystem::path& to) const;
  void conclude(Outcome, std::stop_token service_stop);
  void tell_resumed(const std::string& text);
  /// Runs `change` under the job's mutex; a store failure is logged, since the bake can go on.
  void record(const std::function<void()>& change);

  const RunContext& context_;
  LiveJob& job_;
  const JobLog log_;
  std::atomic<bool> timed_out_{false};
  std::atomic<std::uint64_t> texels_{0};
  bool deferred_ = false;
  std::chrono::steady_clock::time_point last_progress_{};  ///< guarded by job_.mutex
};

}  // namespace kiln::jobs
