#include "server/jobs/admission.h"

#include <utility>

#include "server/base/clock.h"

namespace kiln::jobs {

Admission::Admission(const JobLimits& limits, JobRegistry& registry, const store::JobStore& store)
    : limits_(limits),
      registry_(registry),
      store_(store),
      memory_(limits.memory ? limits.memory
                            : std::make_shared<base::MemoryBudget>(limits.memory_bytes)) {
  memory_->on_free([this] { registry_.wake(); });
}

Admission::~Admission() {
  memory_->on_free({});
}

proto::Expected<void> Admission::check(const Lock& lock, const std::string& tenant) const {
  const JobQueue& queue = std::as_const(registry_).queue(lock);
  if (draining_)
    return proto::fail("draining", "The service is shutting down and takes no new jobs.");
  if (queue.size() + held_places_ >= limits_.queued)
    return proto::fail("queue_full", "The queue is full (" + std::to_string(limits_.queued) +
                                         " jobs are waiting).");
  if (limits_.tenant_queued > 0 && queue.waiting(tenant) >= limits_.tenant_queued)
    return proto::fail("quota_exceeded", "As many jobs of this tenant are waiting as may (" +
                                             std::to_string(limits_.tenant_queued) + ").");
  if (limits_.tenant_bytes > 0 && store_.result_bytes(tenant) >= limits_.tenant_bytes)
    return proto::fail("quota_exceeded", "The results of this tenant's jobs have reached " +
                                             std::to_string(limits_.tenant_bytes) +
                                             " bytes: delete some.");
  return check_day(tenant);
}

proto::Expected<void> Admission::check_day(const std::string& tenant) const {
  if (limits_.tenant_texels == 0 && limits_.tenant_cpu_seconds == 0) return {};
  const auto today = store_.usage(tenant, base::today());
  const auto refuse = [](std::uint64_t limit, const char* what) {
    return proto::fail("quota_exceeded", "The tenant's jobs have taken their " +
                                             std::to_string(limit) + " " + what +
                                             " of this day (UTC).");
  };
  if (limits_.tenant_texels > 0 && today.texels >= limits_.tenant_texels)
    return refuse(limits_.tenant_texels, "texels");
  if (limits_.tenant_cpu_seconds > 0 && today.cpu_seconds >= double(limits_.tenant_cpu_seconds))
    return refuse(limits_.tenant_cpu_seconds, "processor seconds");
  return {};
}

proto::Expected<Admission::Place> Admission::hold_place(const std::string& tenant) {
  const Lock lock = registry_.lock();
  if (auto room = check(lock, tenant); !room) return proto::Unexpected(room.error());
  ++held_places_;
  return Place(*this);
}

Admission::Place::~Place() {
  if (admission_ != nullptr) give_up(admission_->registry_.lock());
}

void Admission::Place::give_up(const Lock&) {
  --std::exchange(admission_, nullptr)->held_places_;
}

JobPtr Admission::take_next(const Lock& lock) {
  if (draining_) return nullptr;
  JobQueue& queue = registry_.queue(lock);
  // One job may always run; reserve() refuses it if it is too large by itself. It waits while
  // imports hold the memory; on_free() wakes it.
  const bool alone = queue.running() == 0 && memory_->imports_are_modest();
  const auto next = queue.take(limits_.tenant_running, alone ? UINT64_MAX : memory_->free_bytes());
  if (!next) return nullptr;
  const JobPtr job = registry_.at_sequence(lock, next->sequence);
  if (next->bytes == 0 || next->bytes > memory_->for_bakes()) return job;
  if (memory_->reserve(job->id, next->bytes)) return job;
  queue.release(next->tenant);  // an import came in between
  queue.insert(*next);
  return nullptr;
}

void Admission::release(const ActiveJob& job) {
  const Lock lock = registry_.lock();
  registry_.queue(lock).release(job.tenant);
  memory_->release(job.id);
}

MemoryGrant Admission::reserve(const ActiveJob& job, std::uint64_t bytes) {
  if (bytes > memory_->for_bakes()) return MemoryGrant::kNever;
  return memory_->reserve(job.id, bytes) ? MemoryGrant::kGranted : MemoryGrant::kWait;
}

std::uint64_t Admission::memory_limit() const {
  const std::uint64_t all = memory_->for_bakes();
  return all == UINT64_MAX ? 0 : all;
}

Admission::Counts Admission::counts() const {
  const Lock lock = registry_.lock();
  const JobQueue& queue = std::as_const(registry_).queue(lock);
  return {queue.size(), queue.running(), memory_->reserved()};
}

Admission::Usage Admission::usage(const std::string& tenant) const {
  Usage usage;
  usage.day = base::today();
  usage.today = store_.usage(tenant, usage.day);
  usage.result_bytes = store_.result_bytes(tenant);
  const Lock lock = registry_.lock();
  const JobQueue& queue = std::as_const(registry_).queue(lock);
  usage.queued = queue.waiting(tenant);
  usage.running = queue.running(tenant);
  return usage;
}

void Admission::begin_drain() {
  const Lock lock = registry_.lock();
  draining_ = true;
}

bool Admission::wait_idle(std::chrono::milliseconds time) const {
  Lock lock = registry_.lock();
  return registry_.wait(lock, time, [&] { return registry_.queue(lock).running() == 0; });
}

}  // namespace kiln::jobs
