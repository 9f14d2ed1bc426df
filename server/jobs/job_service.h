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
#include "server/jobs/event_ring.h"
#include "server/jobs/job_store.h"
#include "server/storage/data_folder.h"
#include "server/storage/scene_store.h"

namespace kiln::server {

struct LiveJob;

/// baker::bake, or a test's stand-in.
using BakeFunction = std::function<proto::Expected<proto::Manifest>(
    const baker::BakeInput&, baker::ThreadPool&, std::stop_token, baker::BakeObserver&)>;

struct JobLimits {
  std::uint32_t running = 2;    ///< jobs at once
  std::uint32_t queued = 1000;  ///< waiting jobs; beyond: `queue_full`
  std::uint32_t crashes = 3;    ///< attempts in a row that may end with the process, without one
                                ///< more pass done, before a job fails
  std::chrono::milliseconds progress_interval{250};  ///< between two job.progress events
};

/// The job queue: takes jobs, runs them oldest first, keeps their state and events. A job that
/// submit() returned is on the disk. Thread-safe. Store failures are DatabaseError.
///
/// States: queued -> preparing -> running -> finalizing -> succeeded | failed | canceled, with
/// canceling in between; back to queued, with the next attempt, when the process ended in between.
/// That attempt goes on after the last pass that was done.
class JobService {
 public:
  /// Takes up the jobs that an earlier process left, then starts the runners.
  JobService(const DataFolder&, JobStore&, const SceneStore&, baker::ThreadPool&, BakeFunction,
             JobLimits, baker::ImportLimits = {});
  ~JobService();  ///< stop(), unless done
  JobService(const JobService&) = delete;
  JobService& operator=(const JobService&) = delete;

  /// Whether submit() would take a job now: worth knowing before an upload is read.
  /// Errors: `queue_full`, `draining`.
  proto::Expected<void> accepting() const;
  /// Same errors.
  proto::Expected<proto::Job> submit(const StoredScene&, const proto::BakeSettings&);
  /// Errors: `not_found`.
  proto::Expected<proto::Job> get(const std::string& id) const;
  /// As get(), but waits until the job is over, the time is up, or release_waiters() was called.
  proto::Expected<proto::Job> wait(const std::string& id, std::chrono::milliseconds) const;

  struct Page {
    std::vector<proto::Job> jobs;
    std::optional<std::int64_t> next;  ///< `before` of the next page
  };
  Page list(const JobFilter&) const;

  /// A queued job is over at once; a running one turns to canceling. No change to one that is over.
  /// Errors: `not_found`.
  proto::Expected<proto::Job> cancel(const std::string& id);
  /// Deletes a job that is over, with its files. `force` cancels it first.
  /// Errors: `not_found`, `job_not_terminal`.
  proto::Expected<void> remove(const std::string& id, bool force);

  /// The job's events: a ring that a stream can follow. For a job that is over it never changes.
  std::shared_ptr<const EventRing> events(const std::string& id) const;  ///< null: no such job
  /// The latest pass of a running job. Empty (null members) when there is none.
  baker::Snapshot snapshot(const std::string& id) const;
  std::vector<proto::ResultFile> results(const std::string& id) const;

  /// Called after each new event, from any thread, with no lock held.
  void on_event(std::function<void(const EventRing*)>);

  struct Counts {
    std::size_t queued = 0, running = 0;
  };
  Counts counts() const;

  void begin_drain();  ///< no new jobs from now on, and no queued one is started
  /// Whether the running jobs ended in time.
  bool wait_idle(std::chrono::milliseconds) const;
  /// Stops running jobs, which go back to the queue for the next process, and joins the runners.
  void stop();
  /// Makes every wait() return.
  void release_waiters();

 private:
  using LivePtr = std::shared_ptr<LiveJob>;

  proto::Expected<void> check_room() const;  ///< needs mutex_
  void recover();
  void add_live(const LivePtr&);
  LivePtr live(const std::string& id) const;
  LivePtr next_job(std::stop_token);
  void runner_loop(std::stop_token);
  void settle(const LivePtr&);
  void notify(const LiveJob&);
  void retire(const LivePtr&);

  const DataFolder& data_;
  JobStore& store_;
  const SceneStore& scenes_;
  baker::ThreadPool& pool_;
  BakeFunction bake_;
  JobLimits limits_;
  baker::ImportLimits import_limits_;
  std::function<void(const EventRing*)> event_hook_;

  mutable std::mutex mutex_;  ///< guards what follows
  mutable std::condition_variable_any changed_;
  std::map<std::string, LivePtr> live_;                    ///< jobs that are not over
  std::set<std::pair<std::int64_t, std::int64_t>> queue_;  ///< (-priority, sequence)
  std::map<std::int64_t, LivePtr> by_sequence_;
  std::size_t running_ = 0;
  std::size_t submitting_ = 0;
  bool draining_ = false;
  bool waiters_released_ = false;

  std::vector<std::jthread> runners_;
};

}  // namespace kiln::server
