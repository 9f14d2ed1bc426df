#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/database.h"
#include "server/store/job_store.h"

/// Makes jobs of the job store's rows: for its own .cpp files.
namespace kiln::store {

/// The beginning of every query that read_job_row() understands.
inline constexpr std::string_view kJobColumns =
    "SELECT sequence, id, state, priority, attempt, crashes, version, scene, scene_bytes, settings,"
    " created_at, started_at, finished_at, stage, pass, max_passes, batches_done, batches_total,"
    " residual, fraction, error, bake_key, labels, ttl_seconds, expires_at, cached, tenant,"
    " webhook, memory_estimate"
    " FROM job ";
inline constexpr std::string_view kIsOver = "state IN ('succeeded', 'failed', 'canceled') ";

inline std::int64_t as_int(std::uint64_t value) {
  return static_cast<std::int64_t>(value);
}

/// An event's data with the job's id in front: {"job":"job_...", ...}
std::string with_job(const std::string& id, const std::string& data);

StoredJob read_job_row(const Statement& row);
std::vector<StoredJob> read_job_rows(Statement& rows);  ///< all that are left

}  // namespace kiln::store
