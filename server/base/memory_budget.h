#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <string>

#include "proto/expected.h"

namespace kiln::base {

/// The machine's memory, shared between bakes, which reserve what they are estimated to take, and
/// import processes, which are held to what they were given. Thread-safe.
///
/// So that an upload can be read while bakes have all that is theirs, a little is set aside for
/// each of the import processes that may run at once; what one needs beyond comes from what bakes
/// left, and is waited for.
class MemoryBudget {
 public:
  struct Imports {
    std::uint32_t processes = 0;                           ///< at once; 0: there are none
    std::uint64_t most_bytes = 0;                          ///< that one is ever given
    std::uint64_t least_bytes = std::uint64_t(256) << 20;  ///< set aside for each, if that leaves
                                                           ///< three quarters for bakes
    /// Less is of no use to any: where not so much can be set aside for each, there are fewer.
    std::uint64_t floor_bytes = std::uint64_t(64) << 20;
    std::uint32_t impatient = UINT32_MAX;  ///< that may wait at a time with `patience`
  };
  /// @param bytes 0: no limit
  explicit MemoryBudget(std::uint64_t bytes) : MemoryBudget(bytes, Imports{}) {}
  MemoryBudget(std::uint64_t bytes, Imports);
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  /// Returns what all bakes together may reserve; UINT64_MAX: no limit.
  std::uint64_t for_bakes() const;
  /// Returns what one more may reserve now.
  std::uint64_t free_bytes() const;
  /// Whether import processes have, and wait for, nothing beyond what is set aside for them.
  bool imports_are_modest() const;
  /// Reserves so much for a job, in place of what it had. False, and no change, when there is not
  /// so much beside the others.
  bool reserve(const std::string& job, std::uint64_t bytes);
  void release(const std::string& job);
  std::uint64_t reserved() const;  ///< by bakes
  std::uint64_t reserved(const std::string& job) const;

  /// The right to run one import process. Ends with the object.
  class Place {
   public:
    Place(Place&& other) noexcept;
    Place& operator=(Place&&) = delete;
    ~Place();
    std::uint64_t bytes() const { return bytes_; }  ///< that the process may take; 0: no limit

   private:
    friend class MemoryBudget;
    Place(MemoryBudget& budget, std::uint64_t bytes, std::uint64_t taken)
        : budget_(&budget), bytes_(bytes), taken_(taken) {}
    MemoryBudget* budget_;
    std::uint64_t bytes_, taken_;
  };
  std::uint32_t processes() const { return imports_.processes; }  ///< import processes at once
  /// Most that an import process can be given, once bakes have ended. 0: no limit.
  std::uint64_t for_import() const;
  /// Waits for a place with so many bytes; fewer than the least become the least. Who waits for
  /// more than that is served in the order of arrival, and bakes that would need what is waited for
  /// are not let in meanwhile.
  ///
  /// A process of `job` draws on what the job has reserved, since its process and its bake take
  /// turns. When that is not enough the job gives it up for as long as it waits: a job that waits
  /// holds nothing, so that no two wait for each other. It has it again when it is let in. Errors:
  /// `canceled`; `overloaded` when it takes longer than `patience`.
  proto::Expected<Place> enter(std::uint64_t bytes, std::stop_token,
                               std::optional<std::chrono::milliseconds> patience = {},
                               const std::string& job = {});

  /// For those that were refused: calls `wake` once, from any thread and with no lock held, when a
  /// process has ended, the longest watch first. Ends with what it returns.
  std::shared_ptr<const void> watch(std::function<void()> wake);

  /// Called when memory that a process had is free for bakes, with no lock held. Set once, before
  /// there are any.
  void on_free(std::function<void()> hook) { hook_ = std::move(hook); }

 private:
  std::uint64_t free_without_waiting() const;  ///< needs mutex_, as do the others
  std::uint64_t beyond_least(std::uint64_t bytes) const;
  std::uint64_t own(const std::string& job) const;
  void leave(std::uint64_t taken);

  const std::uint64_t bytes_;
  Imports imports_;
  std::uint64_t set_aside_ = 0;
  std::function<void()> hook_;

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::string, std::uint64_t> reserved_;  ///< by job
  std::uint32_t running_ = 0;                      ///< import processes
  std::uint64_t taken_ = 0;                        ///< by them, beyond what is set aside
  std::uint64_t wanted_ = 0;                       ///< likewise, by those that wait
  std::uint32_t impatient_ = 0;                    ///< that wait with patience
  std::uint64_t last_ticket_ = 0;
  std::set<std::uint64_t> line_;  ///< tickets of those that wait for memory
  std::list<std::weak_ptr<const std::function<void()>>> watches_;
};

}  // namespace kiln::base
