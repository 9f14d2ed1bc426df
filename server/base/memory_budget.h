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
#include <utility>

#include "proto/expected.h"

namespace kiln::base {

/// Shares the machine's memory between bakes, which reserve what they are estimated to take, and
/// import processes, which are held to what they were given. Thread-safe.
///
/// A little is set aside for each of the import processes that may run at once, so that an upload
/// can be read while bakes have all of theirs. What a process needs beyond comes from what bakes
/// left, and is waited for.
class MemoryBudget {
 public:
  struct Imports {
    std::uint32_t processes = 0;   ///< at once; 0: there are none
    std::uint64_t most_bytes = 0;  ///< the most that a process is ever given
    std::uint64_t least_bytes = std::uint64_t(256) << 20;  ///< set aside for each, if that leaves
                                                           ///< three quarters for bakes
    /// Less is of no use to any: where not so much can be set aside for each, there are fewer.
    std::uint64_t floor_bytes = std::uint64_t(64) << 20;
    std::uint32_t impatient = UINT32_MAX;  ///< number that may wait at a time with `patience`
  };
  /// @param bytes 0: no limit
  explicit MemoryBudget(std::uint64_t bytes) : MemoryBudget(bytes, Imports{}) {}
  MemoryBudget(std::uint64_t bytes, Imports);
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  /// Returns what all bakes together may reserve; UINT64_MAX: no limit.
  std::uint64_t for_bakes() const;
  /// Returns what one more may reserve now, with what is kept for later only.
  std::uint64_t free_bytes() const;
  /// Returns whether import processes have, and wait for, nothing beyond what is set aside for
  /// them.
  bool imports_are_modest() const;
  /// Reserves so much for a job, in place of what it had. Returns false, and changes nothing, when
  /// there is not so much beside the others.
  bool reserve(const std::string& job, std::uint64_t bytes);
  void release(const std::string& job);
  std::uint64_t reserved() const;  ///< bytes reserved by bakes and loans
  std::uint64_t reserved(const std::string& job) const;

  /// Memory of work that is neither a bake nor an import. Ends with the object.
  class Loan {
   public:
    Loan(Loan&& other) noexcept;
    Loan& operator=(Loan&&) = delete;
    ~Loan();

   private:
    friend class MemoryBudget;
    Loan(MemoryBudget& budget, std::string name) : budget_(&budget), name_(std::move(name)) {}
    MemoryBudget* budget_;
    std::string name_;
  };
  /// Takes so much of what bakes have left. Returns nothing when there is not so much now.
  std::optional<Loan> borrow(std::uint64_t bytes);

  /// The right to run one import process. Ends with the object.
  class Place {
   public:
    Place(Place&& other) noexcept;
    Place& operator=(Place&&) = delete;
    ~Place();
    std::uint64_t bytes() const { return bytes_; }  ///< limit of the process; 0: none

   private:
    friend class MemoryBudget;
    Place(MemoryBudget& budget, std::uint64_t bytes, std::uint64_t taken)
        : budget_(&budget), bytes_(bytes), taken_(taken) {}
    MemoryBudget* budget_;
    std::uint64_t bytes_, taken_;
  };
  std::uint32_t processes() const { return imports_.processes; }  ///< import processes at once
  /// Returns the most that an import process can be given, once bakes have ended. 0: no limit.
  std::uint64_t for_import() const;
  /// Waits for a place with so many bytes; fewer than the least become the least. Callers that wait
  /// for more than that are served in the order of arrival, and bakes that would need what is
  /// waited for are not let in meanwhile.
  ///
  /// A process of `job` draws on what the job has reserved, since its process and its bake take
  /// turns. When that is not enough the job gives it up for as long as it waits: a job that waits
  /// holds nothing, so that no two wait for each other. It has it again when it is let in. Errors:
  /// `canceled`; `overloaded` when it takes longer than `patience`.
  proto::Expected<Place> enter(std::uint64_t bytes, std::stop_token,
                               std::optional<std::chrono::milliseconds> patience = {},
                               const std::string& job = {});

  /// Calls `wake` once when a process has ended, for a caller that was refused. The call comes from
  /// any thread with no lock held, the longest watch first. The watch ends with what this returns.
  std::shared_ptr<const void> watch(std::function<void()> wake);

  /// Called, with no lock held, when a process has to wait because all places are taken: it gives
  /// up a place that is held for later, and returns false when there is none. Set once, before
  /// there are any.
  void on_crowded(std::function<bool()> hook) { crowded_ = std::move(hook); }

  /// Called when memory that a process or a loan had is free for bakes, with no lock held. Set
  /// once, before there are any.
  void on_free(std::function<void()> hook) { hook_ = std::move(hook); }

  /// Reservations that are kept for later only: whoever lacks memory gets theirs.
  struct Spare {
    std::function<std::uint64_t()> bytes;  ///< of all of them; it takes no lock
    /// Called with no lock of the budget's held, but perhaps with a caller's: releases about so
    /// many bytes, by release(), and returns false when there was nothing to release.
    std::function<bool(std::uint64_t bytes)> give_back;
  };
  /// Set once, before there are any.
  void on_scarce(Spare spare) { spare_ = std::move(spare); }
  std::uint64_t spare() const { return spare_bytes(); }  ///< bytes of Spare; any thread
  /// Tells that reservations were released, or are kept for later only from now on: gives back what
  /// somebody waits for, and calls on_free(). Called with no lock held.
  void announce();

 private:
  /// Returns what Spare::bytes says.
  std::uint64_t spare_bytes() const { return spare_.bytes ? spare_.bytes() : 0; }
  /// Has spare memory given back, up to so much, with `lock`, that of mutex_, open meanwhile.
  /// Returns false when there was none.
  bool give_back(std::unique_lock<std::mutex>& lock, std::uint64_t missing);
  std::uint64_t free_without_waiting() const;  ///< needs mutex_, as do the others
  std::uint64_t beyond_least(std::uint64_t bytes) const;
  std::uint64_t own(const std::string& job) const;
  void leave(std::uint64_t taken);

  const std::uint64_t bytes_;
  Imports imports_;
  std::uint64_t set_aside_ = 0;
  std::function<void()> hook_;
  std::function<bool()> crowded_;
  Spare spare_;

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::string, std::uint64_t> reserved_;  ///< bytes by job, or by the name of a loan
  std::uint32_t running_ = 0;                      ///< import processes
  std::uint64_t taken_ = 0;      ///< bytes taken by processes, beyond what is set aside
  std::uint64_t wanted_ = 0;     ///< likewise, by those that wait
  std::uint32_t impatient_ = 0;  ///< number that wait with patience
  std::uint64_t last_ticket_ = 0, last_loan_ = 0;
  std::set<std::uint64_t> line_;  ///< tickets of those that wait for memory
  std::list<std::weak_ptr<const std::function<void()>>> watches_;
};

}  // namespace kiln::base
