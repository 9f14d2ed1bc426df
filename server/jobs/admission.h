#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "proto/expected.h"
#include "server/base/memory_budget.h"
#include "server/jobs/job_limits.h"
#include "server/jobs/job_registry.h"
#include "server/store/job_store.h"

namespace kiln::jobs {

/// Answers a bake that asks for memory.
enum class MemoryGrant {
  kGranted,
  kWait,   ///< there is no room for it beside those that run now
  kNever,  ///< it is over the budget by itself
};

/// Decides which jobs are taken (room in the queue, quotas, a drain), and when each may run (its
/// turn, its tenant's share, memory). Thread-safe; throws DatabaseError.
class Admission {
 public:
  using Lock = JobRegistry::Lock;

  Admission(const JobLimits&, JobRegistry&, const store::JobStore&);
  ~Admission();
  Admission(const Admission&) = delete;
  Admission& operator=(const Admission&) = delete;

  /// Checks whether a job of this tenant would be taken now.
  /// Errors: `queue_full`, `draining`, `quota_exceeded`.
  proto::Expected<void> check(const Lock&, const std::string& tenant) const;

  /// Checks whether the tenant's work of this day leaves it some. Errors: `quota_exceeded`.
  proto::Expected<void> check_day(const std::string& tenant) const;

  /// A place in the queue, held for a job that is being stored. It ends with the object.
  class Place {
   public:
    Place(Place&& other) noexcept : admission_(std::exchange(other.admission_, nullptr)) {}
    Place& operator=(Place&&) = delete;
    ~Place();
    void give_up(const Lock&);  ///< at the moment when the job takes it

   private:
    friend class Admission;
    explicit Place(Admission& admission) : admission_(&admission) {}
    Admission* admission_;
  };
  /// Holds a place. Errors: those of check().
  proto::Expected<Place> hold_place(const std::string& tenant);

  /// Takes the next job that may run now out of the queue, with the memory that it is known to
  /// need. Returns null when there is none.
  JobPtr take_next(const Lock&);
  /// Notes that a job which take_next() gave has stopped running.
  void release(const ActiveJob&);
  /// Reserves memory for a running job, in place of what it had.
  MemoryGrant reserve(const ActiveJob&, std::uint64_t bytes);
  std::uint64_t memory_limit() const;  ///< limit of one bake's estimate; 0: none
  std::uint64_t bake_memory() const {
    return memory_->for_bakes();
  }  ///< memory of all bakes together

  struct Counts {
    std::size_t queued = 0, running = 0;
    std::uint64_t reserved_bytes = 0;  ///< memory of those that run
  };
  Counts counts() const;

  /// The amounts that a tenant has and has taken, for its quotas.
  struct Usage {
    std::size_t queued = 0, running = 0;
    std::uint64_t result_bytes = 0;
    std::string day;  ///< "2026-11-22", UTC
    store::Usage today;
  };
  Usage usage(const std::string& tenant) const;

  void begin_drain();  ///< takes no job, and starts no queued one, from now on
  /// Returns whether the running jobs ended in time.
  bool wait_idle(std::chrono::milliseconds) const;

 private:
  const JobLimits& limits_;
  JobRegistry& registry_;
  const store::JobStore& store_;
  const std::shared_ptr<base::MemoryBudget> memory_;
  // The registry's lock guards these.
  std::size_t held_places_ = 0;
  bool draining_ = false;
};

}  // namespace kiln::jobs
