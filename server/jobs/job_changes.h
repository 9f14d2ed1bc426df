#pragma once

#include <optional>
#include <vector>

#include "proto/event.h"
#include "proto/expected.h"
#include "proto/manifest.h"
#include "server/jobs/live_job.h"
#include "server/store/job_store.h"

/// Every way a job can change. Each stores the change and its events in one transaction, then shows
/// both to readers. The caller holds job.mutex. When the store throws, the job is as it was.
namespace kiln::jobs {

/// The last events of a job in its terminal state: result.ready when there are files, job.state,
/// job.end.
std::vector<proto::Event> end_events(const LiveJob&, const std::vector<proto::ResultFile>&);

void change_state(store::JobStore&, LiveJob&, proto::JobState, store::Database::Durability);
/// Terminal state, with end_events().
void finish_job(store::JobStore&, LiveJob&, proto::JobState, std::optional<proto::Error>,
                const std::vector<proto::ResultFile>&);
/// Back to the queue, for the next attempt.
void requeue_job(store::JobStore&, LiveJob&);
/// The same for a job that was over.
void restart_job(store::JobStore&, LiveJob&);
/// Back to the queue as the same attempt, since there is no room for its memory now.
void defer_job(store::JobStore&, LiveJob&);
/// When a job that is over expires; "" when it is kept for ever.
std::string expiry(const proto::Job&);
/// Priority, labels and time to live. No event: streams tell how a bake goes.
void patch_job(store::JobStore&, LiveJob&, const proto::JobPatch&);
/// One event about the job as it is now; the version grows.
void add_event(store::JobStore&, LiveJob&, const char* type, const nlohmann::json& data);

}  // namespace kiln::jobs
