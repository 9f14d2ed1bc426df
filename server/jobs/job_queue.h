#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace kiln::jobs {

/// Decides which job runs next: the highest priority; of the same priority the tenant with the
/// fewest running jobs, so that many jobs of one keep no other waiting; of the same tenant the
/// oldest. Not thread-safe.
class JobQueue {
 public:
  struct Entry {
    std::string tenant;
    std::int64_t priority = 0;
    std::int64_t sequence = 0;  ///< unique
    std::uint64_t bytes = 0;    ///< of memory that it needs; 0: not known yet
  };

  void insert(const Entry&);
  bool erase(const Entry&);  ///< whether it was there
  bool contains(const Entry&) const;
  /// Returns how many come before it by priority and age, plus one; 0: it does not wait. Fair share
  /// between tenants may let others pass.
  std::size_t position(const Entry&) const;

  /// Takes the next job out and counts it as running. Tenants with `max_running` running jobs wait;
  /// 0: no limit. A job that needs more than `free_bytes` waits, and all behind it with it: would
  /// smaller ones pass it, it could wait for ever.
  std::optional<Entry> take(std::size_t max_running, std::uint64_t free_bytes = UINT64_MAX);
  void release(const std::string& tenant);  ///< a job that take() gave has stopped running

  std::size_t size() const { return size_; }
  std::size_t waiting(const std::string& tenant) const { return count(waiting_, tenant); }
  std::size_t running() const { return running_total_; }
  std::size_t running(const std::string& tenant) const { return count(running_, tenant); }

 private:
  using Counts = std::map<std::string, std::size_t>;
  static std::size_t count(const Counts&, const std::string&);
  static void less(Counts&, const std::string&);

  using Jobs = std::map<std::int64_t, std::uint64_t>;                       ///< bytes by sequence
  using Level = std::map<std::string, Jobs>;                                ///< by tenant
  std::map<std::int64_t, Level, std::greater<>> levels_;                    ///< by priority
  std::map<std::int64_t, std::vector<std::int64_t>, std::greater<>> ages_;  ///< sorted sequences
  std::size_t size_ = 0, running_total_ = 0;
  Counts waiting_, running_;
};

}  // namespace kiln::jobs
