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
  std::chrono::milliseconds progress_interval{250};  ///< time between two job.progress events
  std::chrono::seconds run{0};    ///< longest attempt; beyond: `bake_timeout`; 0: no limit
  std::uint64_t ttl_seconds = 0;  ///< for jobs that set none; 0: for ever
  /// The numbers of jobs of one tenant; 0: no limit. A job beyond the first is `quota_exceeded`;
  /// one beyond the second waits.
  std::uint32_t tenant_queued = 0, tenant_running = 0;
  std::uint64_t tenant_bytes = 0;  ///< result files of all its jobs; 0: no limit
  /// The most that one tenant's bakes may take in a day of UTC; 0: no limit.
  std::uint64_t tenant_texels = 0, tenant_cpu_seconds = 0;
  double checkpoint_share = 0.05;               ///< see baker::BakeInput
  std::chrono::milliseconds part_time{10'000};  ///< likewise
  std::uint64_t memory_bytes = 0;  ///< memory of running bakes, by their estimates; 0: no limit
  /// The shared budget that replaces memory_bytes; null: there is none.
  std::shared_ptr<base::MemoryBudget> memory = nullptr;
};

}  // namespace kiln::jobs
