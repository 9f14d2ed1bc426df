#include "server/jobs/live_job.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::jobs {

JobQueue::Entry queue_entry(const store::StoredJob& s) {
  return {s.job.tenant, s.job.priority, s.sequence, s.job.memory_estimate_bytes};
}

LiveJob::LiveJob(store::StoredJob from, std::vector<proto::Event> kept)
    : id(from.job.id), stored(std::move(from)) {
  const std::uint64_t last = kept.empty() ? 0 : kept.back().id;
  ring = std::make_shared<base::EventRing>(last, std::move(kept));
}

proto::Event LiveJob::event(std::string type, const nlohmann::json& data,
                            std::size_t already) const {
  return {ring->last() + 1 + already, std::move(type), proto::to_text(data)};
}

proto::Event LiveJob::state_event(std::size_t already) const {
  nlohmann::json data{{"state", proto::to_string(stored.job.state)},
                      {"attempt", stored.job.attempt}};
  if (stored.job.error) data["error"] = proto::to_json(*stored.job.error);
  return event("job.state", data, already);
}

}  // namespace kiln::jobs
