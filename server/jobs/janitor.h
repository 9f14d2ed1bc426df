#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <thread>

#include "server/data/scene_store.h"
#include "server/data/upload_store.h"
#include "server/jobs/job_control.h"

namespace kiln::jobs {

/// Bounds what is kept although no client asked for it again.
struct Retention {
  /// The time that scenes without a job, and checkpoints of jobs that failed or were canceled, are
  /// kept.
  std::chrono::seconds leftovers{86'400};
  /// The largest size of the data folder: above it jobs that are over are deleted, oldest first. 0:
  /// no limit.
  std::uint64_t max_bytes = 0;
};

/// Deletes what is no longer needed, on a thread of its own: jobs past their time to live,
/// unfinished uploads, leftovers, then old jobs as far as the disk budget asks for it.
class Janitor {
 public:
  Janitor(const data::DataFolder&, store::JobStore&, const data::SceneStore&, data::UploadStore&,
          JobControl&, Retention, std::chrono::milliseconds interval);
  /// Does one round, on the calling thread. Throws DatabaseError.
  void sweep();

 private:
  void sweep_jobs();
  void sweep_checkpoints() const;
  void sweep_scenes() const;
  void sweep_to_budget();
  void remove_job(const std::string& id, const char* reason);

  const data::DataFolder& data_;
  store::JobStore& store_;
  const data::SceneStore& scenes_;
  data::UploadStore& uploads_;
  JobControl& jobs_;
  Retention retention_;
  std::mutex sweeping_;  ///< two rounds at once would both free the room that one of them needs
  std::jthread thread_;
};

}  // namespace kiln::jobs
