#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "baker/bake.h"
#include "proto/expected.h"
#include "proto/job.h"
#include "server/base/event_ring.h"
#include "server/jobs/job_registry.h"
#include "server/jobs/job_watches.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// Answers readers about all jobs: those in memory as they are now, those that are over as of the
/// store. Thread-safe. Throws DatabaseError.
class JobLookup {
 public:
  JobLookup(const JobRegistry& registry, const store::JobStore& store, JobWatches& watches)
      : registry_(registry), store_(store), watches_(watches) {}

  /// Errors: `not_found`.
  proto::Expected<proto::Job> get(const std::string& id) const;
  struct Page {
    std::vector<proto::Job> jobs;
    std::optional<std::int64_t> next;  ///< `before` of the next page
  };
  Page list(const store::JobFilter&) const;
  /// The jobs that are not over, by id; of all tenants when none is given.
  std::vector<proto::Job> unfinished(const std::optional<std::string>& tenant) const;
  /// The job's place in the line, see JobQueue::position(); 0: it does not wait, or there is none.
  std::size_t queue_position(const std::string& id) const;

  /// The job's events, as a ring that a stream can follow. For a job that is over it never changes.
  /// Null: there is no such job.
  std::shared_ptr<const base::EventRing> events(const std::string& id) const;
  /// The latest pass of a running job. Null members: there is none.
  baker::Snapshot snapshot(const std::string& id) const;
  std::vector<proto::ResultFile> results(const std::string& id) const;

  /// Calls `moved` once, from any thread, as soon as the job is over or there is none; with `since`
  /// as soon as its version is later. Calls it at once where that is so already.
  JobWatches::Watch watch(const std::string& id, std::optional<std::uint64_t> since,
                          std::function<void()> moved) const;

 private:
  const JobRegistry& registry_;
  const store::JobStore& store_;
  JobWatches& watches_;
};

}  // namespace kiln::jobs
