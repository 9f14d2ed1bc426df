#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "baker/bake.h"
#include "server/base/event_ring.h"
#include "server/jobs/job_queue.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// Where a job stands in the queue.
JobQueue::Entry queue_entry(const store::StoredJob&);

/// A job that is not over, in memory. Every change of `stored` goes through change(), which keeps
/// store, events and memory in step.
struct LiveJob {
  explicit LiveJob(store::StoredJob stored, std::vector<proto::Event> kept = {});

  const std::string id;
  std::shared_ptr<base::EventRing> ring;
  std::stop_source stop;    ///< as soon as possible, without a result
  std::stop_source enough;  ///< with the light of the passes that are done

  mutable std::mutex mutex;  ///< guards what follows
  store::StoredJob stored;
  baker::Snapshot snapshot;
  bool cancel_requested = false;
  std::chrono::steady_clock::time_point waiting_since = std::chrono::steady_clock::now();

  /// An event of this job with the next id after `already` others that are not pushed yet. Needs
  /// the mutex.
  proto::Event event(std::string type, const nlohmann::json& data, std::size_t already = 0) const;
  /// job.state with the job's present state and attempt. Needs the mutex.
  proto::Event state_event(std::size_t already = 0) const;
};

}  // namespace kiln::jobs
