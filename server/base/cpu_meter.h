#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <mutex>

namespace kiln::base {

/// Shares the processor time of this process and its ended children among the jobs that run: all of
/// it to one that runs alone, even parts to several, which take turns on the same threads.
/// Thread-safe.
class CpuMeter {
 public:
  /// `clock` returns the processor seconds used so far; a test replaces that of the process.
  explicit CpuMeter(std::function<double()> clock = process_seconds);

  /// Counts one job as running until it is destroyed.
  class Run {
   public:
    explicit Run(CpuMeter&);
    ~Run();
    Run(const Run&) = delete;
    Run& operator=(const Run&) = delete;
    double seconds() const;  ///< so far

   private:
    CpuMeter& meter_;
    std::uint64_t id_ = 0;
  };

  /// Leaves so many seconds of this process out of what the jobs share: they were somebody else's.
  void leave_out(double seconds);

  static double process_seconds();

 private:
  void share();  ///< needs mutex_

  std::function<double()> clock_;
  std::mutex mutex_;
  double seen_ = 0;                         ///< guarded by mutex_
  std::uint64_t next_ = 0;                  ///< guarded by mutex_
  std::map<std::uint64_t, double> shares_;  ///< shares of the jobs that run; guarded by mutex_
};

}  // namespace kiln::base
