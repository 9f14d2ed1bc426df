#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "baker/bake.h"
#include "proto/expected.h"
#include "proto/job.h"
#include "server/base/cpu_meter.h"
#include "server/base/event_ring.h"
#include "server/base/memory_budget.h"
#include "server/data/data_folder.h"
#include "server/data/scene_store.h"
#include "server/jobs/job_queue.h"
#include "server/jobs/job_watches.h"
#include "server/store/job_store.h"

namespace kiln::base {
class Metrics;
}

namespace kiln::jobs {

struct LiveJob;
enum class Admission;

struct JobInput : baker::BakeInput {
  std::string job;  ///< whose bake it is
};

/// baker::bake, or a test's stand-in.
using BakeFunction = std::function<proto::Expected<proto::Manifest>(
    const JobInput&, exec::ThreadPool&, std::stop_token, baker::BakeObserver&)>;

struct JobLimits {
  std::uint32_t running = 2;    ///< jobs at once
  std::uint32_t queued = 1000;  ///< waiting jobs; beyond: `queue_full`
  std::uint32_t crashes = 3;    ///< attempts in a row that may end with the process, without one
                                ///< more pass done, before a job fails
  std::chrono::milliseconds progress_interval{250};  ///< between two job.progress events
  std::chrono::seconds run{0};    ///< of one attempt; beyond: `bake_timeout`; 0: no limit
  std::uint64_t ttl_seconds = 0;  ///< of jobs that don't say; 0: for ever
  /// Of one tenant; 0: no limit. Beyond: `quota_exceeded`, or waiting for the second.
  std::uint32_t tenant_queued = 0, tenant_running = 0;
  std::uint64_t tenant_bytes = 0;  ///< result files of all its jobs; 0: no limit
  /// Of one tenant in a day of UTC; 0: no limit.
  std::uint64_t tenant_texels = 0, tenant_cpu_seconds = 0;
  double checkpoint_share = 0.05;               ///< see baker::BakeInput
  std::chrono::milliseconds part_time{10'000};  ///< likewise
  std::uint64_t memory_bytes = 0;  ///< of running bakes, by their estimates; 0: no limit
  /// Instead, where they share it with others.
  std::shared_ptr<base::MemoryBudget> memory = nullptr;
};

/// What submit() takes.
struct Submission {
  data::StoredScene scene;
  proto::BakeSettings settings;
  proto::JobOptions options;
  std::string tenant;
  std::string idempotency_key;  ///< the client's name for this request; "": none
};

enum class CancelMode {
  kNow,    ///< as soon as possible, without a result
  kDrain,  ///< the light of the passes that are done becomes the result
};

enum class RetryFrom { kCheckpoint, kStart };

/// The job queue: takes jobs, runs them by priority, fair share and age (JobQueue), keeps their
/// state and events. A job that submit() returned is on the disk. Thread-safe. Store failures are
/// DatabaseError.
///
/// States: queued -> preparing -> running -> finalizing -> succeeded | failed | canceled, with
/// canceling in between; back to queued, with the next attempt, when the process ended in between.
/// That attempt goes on after the last pass that was done.
class JobService {
 public:
  /// Takes up the jobs that an earlier process left, clears away what it left besides, then starts
  /// the runners.
  JobService(const data::DataFolder&, store::JobStore&, const data::SceneStore&, exec::ThreadPool&,
             BakeFunction, JobLimits, files::ImportLimits = {}, base::Metrics* = nullptr);
  ~JobService();  ///< stop(), unless done
  JobService(const JobService&) = delete;
  JobService& operator=(const JobService&) = delete;

  /// Whether submit() would take a job of this tenant now: worth knowing before an upload is read.
  /// True when the request of this idempotency key was answered before, since that takes no room.
  /// Errors: `queue_full`, `draining`, `quota_exceeded`.
  proto::Expected<void> accepting(const std::string& tenant,
                                  const std::string& idempotency_key = {}) const;

  struct Submitted {
    proto::Job job;
    bool replayed = false;  ///< the job of an earlier request with the same idempotency key
  };
  /// Queues a job. With options.dedupe, an identical bake that succeeded makes it a job that is
  /// over at once.
  /// Errors: `queue_full`, `draining`, `quota_exceeded`, `idempotency_in_progress`,
  /// `idempotency_mismatch`.
  proto::Expected<Submitted> submit(const Submission&);
  /// Errors: `not_found`.
  proto::Expected<proto::Job> get(const std::string& id) const;
  /// Calls `moved` once, from any thread, as soon as the job is over or there is none; with `since`
  /// as soon as its version is later. At once, where that is so already.
  JobWatches::Watch watch(const std::string& id, std::optional<std::uint64_t> since,
                          std::function<void()> moved);

  /// Whose turn it is when, see JobQueue::position(); 0: it does not wait, or there is no such job.
  std::size_t queue_position(const std::string& id) const;

  struct Page {
    std::vector<proto::Job> jobs;
    std::optional<std::int64_t> next;  ///< `before` of the next page
  };
  Page list(const store::JobFilter&) const;
  /// The jobs that are not over, by id; of all tenants when there is none.
  std::vector<proto::Job> unfinished(const std::optional<std::string>& tenant) const;

  /// A queued job is over at once; a running one turns to canceling. No change to one that is over.
  /// Errors: `not_found`.
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

  /// The job's events: a ring that a stream can follow. For a job that is over it never changes.
  std::shared_ptr<const base::EventRing> events(
      const std::string& id) const;  ///< null: no such job
  /// The latest pass of a running job. Empty (null members) when there is none.
  baker::Snapshot snapshot(const std::string& id) const;
  std::vector<proto::ResultFile> results(const std::string& id) const;

  /// Called after each new event, from any thread, with no lock held.
  void on_event(std::function<void(const base::EventRing*)>);

  struct Counts {
    std::size_t queued = 0, running = 0;
    std::uint64_t reserved_bytes = 0;  ///< of memory, for those that run
  };
  Counts counts() const;
  std::uint64_t memory_limit() const;  ///< that one bake may be estimated to take; 0: there is none

  /// What a tenant has and took, for its quotas.
  struct Usage {
    std::size_t queued = 0, running = 0;
    std::uint64_t result_bytes = 0;
    std::string day;  ///< "2026-11-22", UTC
    store::Usage today;
  };
  Usage usage(const std::string& tenant) const;

  void begin_drain();  ///< no new jobs from now on, and no queued one is started
  /// Whether the running jobs ended in time.
  bool wait_idle(std::chrono::milliseconds) const;
  /// Stops running jobs, which go back to the queue for the next process, and joins the runners.
  void stop();

 private:
  using LivePtr = std::shared_ptr<LiveJob>;
  class KeyInUse;

  proto::Expected<void> check_room(const std::string& tenant) const;  ///< needs mutex_
  proto::Expected<void> check_day(const std::string& tenant) const;
  void recover();
  void clear_leftovers() const;
  void add_live(const LivePtr&);  ///< needs mutex_
  LivePtr live(const std::string& id) const;
  /// Takes a job that may run now, with what it needs reserved. Needs mutex_.
  std::optional<JobQueue::Entry> take_job();
  LivePtr next_job(std::stop_token);
  void runner_loop(std::stop_token);
  bool run_job(const LivePtr&, std::stop_token);
  void settle(const LivePtr&);
  Admission admit(const LiveJob&, std::uint64_t bytes);
  void put_back(const LivePtr&, const std::stop_token&);
  void notify(const LiveJob&);
  void tell_watchers(const LiveJob&);
  void retire(const LivePtr&);

  std::optional<proto::Expected<Submitted>> replay(const store::IdempotencyKey&) const;
  std::optional<proto::Job> submit_cached(const store::StoredJob&,
                                          const std::optional<store::IdempotencyKey>&);
  proto::Expected<proto::Job> enqueue(const store::StoredJob&,
                                      const std::optional<store::IdempotencyKey>&);
  /// A job that is over, as of the store. Waits for a runner that is about to let go of it. Null:
  /// it is not over.
  proto::Expected<LivePtr> find_over(const std::string& id, std::unique_lock<std::mutex>&) const;

  const data::DataFolder& data_;
  store::JobStore& store_;
  const data::SceneStore& scenes_;
  exec::ThreadPool& pool_;
  BakeFunction bake_;
  JobLimits limits_;
  files::ImportLimits import_limits_;
  base::Metrics* metrics_;  ///< null: nobody counts
  base::CpuMeter cpu_meter_;
  const std::shared_ptr<base::MemoryBudget> memory_;
  std::function<void(const base::EventRing*)> event_hook_;
  JobWatches watches_;

  mutable std::mutex mutex_;  ///< guards what follows
  mutable std::condition_variable_any changed_;
  std::map<std::string, LivePtr> live_;  ///< jobs that are not over
  JobQueue queue_;
  std::map<std::int64_t, LivePtr> by_sequence_;
  std::set<std::string> keys_in_use_;  ///< idempotency keys of requests being answered
  std::size_t submitting_ = 0;
  bool draining_ = false;

  std::vector<std::jthread> runners_;
};

}  // namespace kiln::jobs
