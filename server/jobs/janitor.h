#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <thread>

#include "server/data/scene_store.h"
#include "server/data/upload_store.h"
#include "server/jobs/job_control.h"

namespace kiln::jobs {

/// Bounds on what is kept though nobody asked for it again.
struct Retention {
  /// Scenes that no job names, and checkpoints of jobs that failed or were canceled.
  std::chrono::seconds leftovers{86'400};
  /// Jobs that are over go, oldest first, while the data folder is larger. 0: no limit.
  std::uint64_t max_bytes = 0;
};

/// Deletes what is no longer needed, on a thread of its own: jobs past their time to live, uploads
/// that nobody finished, leftovers, then old jobs as far as the disk budget asks for it.
class Janitor {
 public:
  Janitor(const data::DataFolder&, store::JobStore&, const data::SceneStore&, data::UploadStore&,
          JobControl&, Retention, std::chrono::milliseconds interval);
  /// One round, on the calling thread. Throws DatabaseError.
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
