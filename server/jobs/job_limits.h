#pragma once

#include <chrono>
#include <cstdint>
#include <memory>

#include "server/base/memory_budget.h"

namespace kiln::jobs {

/// Limits of jobs, most of them from the configuration.
struct JobLimits {
  std::uint32_t running = 2;    ///< jobs at once
  std::uint32_t queued = 1000;  ///< waiting jobs; beyond: `queue_full`
  std::uint32_t crashes = 3;    ///< attempts in a row that may end with the process, without one
                                ///< more pass done, before a job fails
  std::chrono::milliseconds progress_interval{250};  ///< between two job.progress events
  std::chrono::seconds run{0};    ///< of one attempt; beyond: `bake_timeout`; 0: no limit
  std::uint64_t ttl_seconds = 0;  ///< of jobs that don't say; 0: for ever
  /// Jobs of one tenant; 0: no limit. Beyond: `quota_exceeded`, or waiting for the second.
  std::uint32_t tenant_queued = 0, tenant_running = 0;
  std::uint64_t tenant_bytes = 0;  ///< result files of all its jobs; 0: no limit
  /// What one tenant's bakes take in a day of UTC; 0: no limit.
  std::uint64_t tenant_texels = 0, tenant_cpu_seconds = 0;
  double checkpoint_share = 0.05;               ///< see baker::BakeInput
  std::chrono::milliseconds part_time{10'000};  ///< likewise
  std::uint64_t memory_bytes = 0;  ///< of running bakes, by their estimates; 0: no limit
  /// Instead, where they share it with others.
  std::shared_ptr<base::MemoryBudget> memory = nullptr;
};

}  // namespace kiln::jobs
