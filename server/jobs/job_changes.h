#pragma once

#include <optional>
#include <vector>

#include "proto/expected.h"
#include "proto/manifest.h"
#include "server/jobs/job_store.h"
#include "server/jobs/live_job.h"

/// Every way a job can change. Each stores the change and its events in one transaction, then shows
/// both to readers. The caller holds job.mutex. When the store throws, the job is as it was.
namespace kiln::server {

void change_state(JobStore&, LiveJob&, proto::JobState, Database::Durability);
/// Terminal state: job.state and job.end; result.ready before them when there are files.
void finish_job(JobStore&, LiveJob&, proto::JobState, std::optional<proto::Error>,
                const std::vector<proto::ResultFile>&);
/// Back to the queue, for the next attempt.
void requeue_job(JobStore&, LiveJob&);
/// One event about the job as it is now; the version grows.
void add_event(JobStore&, LiveJob&, const char* type, const nlohmann::json& data);

}  // namespace kiln::server
