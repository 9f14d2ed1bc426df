#include "server/jobs/active_job.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"

namespace kiln::jobs {
namespace {

std::shared_ptr<base::EventRing> make_ring(std::vector<proto::Event> kept) {
  const std::uint64_t last = kept.empty() ? 0 : kept.back().id;
  return std::make_shared<base::EventRing>(last, std::move(kept));
}

}  // namespace

ActiveJob::ActiveJob(store::StoredJob from, std::vector<proto::Event> kept)
    : id(from.job.id),
      tenant(from.job.tenant),
      ring(make_ring(std::move(kept))),
      stored_(std::move(from)) {}

JobQueue::Entry ActiveJob::queue_entry() const {
  return {tenant, job().priority, stored_.sequence, job().memory_estimate_bytes};
}

proto::Event ActiveJob::event(std::string type, const nlohmann::json& data,
                              std::size_t already) const {
  return {ring->last() + 1 + already, std::move(type), proto::to_text(data)};
}

proto::Event ActiveJob::state_event(std::size_t already) const {
  nlohmann::json data{{"state", proto::to_string(job().state)}, {"attempt", job().attempt}};
  if (job().error) data["error"] = proto::to_json(*job().error);
  return event("job.state", data, already);
}

proto::Job ActiveJob::copy() const {
  const std::lock_guard lock(mutex);
  return stored_.job;
}

baker::Snapshot ActiveJob::snapshot() const {
  const std::lock_guard lock(mutex);
  return snapshot_;
}

void ActiveJob::show(baker::Snapshot snapshot) {
  const std::lock_guard lock(mutex);
  snapshot_ = std::move(snapshot);
}

}  // namespace kiln::jobs
