#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "proto/job.h"
#include "proto/manifest.h"

namespace kiln::progress {

/// Reports the stages of a bake with their times, and its progress at a bounded rate.
class ProgressReporter {
 public:
  struct Listener {
    std::function<void(const std::string& stage)> on_stage;
    std::function<void(const proto::JobProgress&)> on_progress;  ///< any thread
  };
  /// @param stages receives the times of stages that are over; outlives the reporter
  ProgressReporter(Listener listener, std::vector<proto::StageReport>& stages)
      : listener_(std::move(listener)), stages_(stages) {}

  /// Ends the stage under way and begins another one. @param fraction of the whole bake, 0 to 1
  void enter(const char* stage, double fraction);
  void leave();
  /// Reports progress within the stage, which is filled in. It drops the report when the last one
  /// is less than 50 ms old, unless all batches are done. Any thread may call it.
  void batch(proto::JobProgress);

 private:
  using Clock = std::chrono::steady_clock;
  double risen_to(double fraction);

  const Listener listener_;
  std::vector<proto::StageReport>& stages_;
  std::string stage_;
  std::atomic<double> fraction_{0};
  Clock::time_point start_;
  std::atomic<Clock::rep> due_{0};
};

}  // namespace kiln::progress
