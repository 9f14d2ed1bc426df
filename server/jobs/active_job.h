#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/bake.h"
#include "server/base/event_ring.h"
#include "server/jobs/job_queue.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// A job that is not over, in memory. Everybody reads it; only JobTransitions changes its fields,
/// and keeps memory, store and events in step.
class ActiveJob {
 public:
  /// @param kept  the events that the store has of it, in order
  explicit ActiveJob(store::StoredJob, std::vector<proto::Event> kept = {});

  const std::string id, tenant;
  const std::shared_ptr<base::EventRing> ring;
  const std::chrono::steady_clock::time_point created = std::chrono::steady_clock::now();
  std::stop_source stop;          ///< ends the bake as soon as possible, without a result
  std::stop_source finish_early;  ///< ends it with the light of the passes that are done

  /// Guards everything below: who calls one of these functions holds it, except for copy(),
  /// snapshot() and show(), which take it.
  mutable std::mutex mutex;

  const store::StoredJob& stored() const { return stored_; }
  const proto::Job& job() const { return stored_.job; }
  bool cancel_requested() const { return cancel_requested_; }
  /// Returns where the job stands in the queue.
  JobQueue::Entry queue_entry() const;
  /// Returns an event of this job with the next id, after `already` others that are not pushed yet.
  proto::Event event(std::string type, const nlohmann::json& data, std::size_t already = 0) const;
  /// Returns job.state with the job's present state and attempt.
  proto::Event state_event(std::size_t already = 0) const;

  proto::Job copy() const;
  /// Returns the latest light of the bake; null members when there is none.
  baker::Snapshot snapshot() const;
  void show(baker::Snapshot);

 private:
  friend class JobTransitions;
  store::StoredJob stored_;
  bool cancel_requested_ = false;
  baker::Snapshot snapshot_;
};

using JobPtr = std::shared_ptr<ActiveJob>;

}  // namespace kiln::jobs
