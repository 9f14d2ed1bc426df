#include "baker/progress/reporter.h"

#include <algorithm>
#include <utility>

namespace kiln::progress {
namespace {

constexpr auto kInterval = std::chrono::milliseconds(50);

}  // namespace

void ProgressReporter::enter(const char* stage, double fraction) {
  leave();
  stage_ = stage;
  start_ = Clock::now();
  listener_.on_stage(stage);
  proto::JobProgress p;
  p.stage = stage_;
  p.fraction = risen_to(fraction);
  listener_.on_progress(p);
}

void ProgressReporter::leave() {
  if (stage_.empty()) return;
  stages_.push_back({stage_, std::chrono::duration<double>(Clock::now() - start_).count()});
  stage_.clear();
}

void ProgressReporter::batch(proto::JobProgress p) {
  const bool last = p.batches_done >= p.batches_total;
  const auto now = Clock::now().time_since_epoch().count();
  auto due = due_.load(std::memory_order_relaxed);
  if (!last && now < due) return;
  const auto next = now + std::chrono::duration_cast<Clock::duration>(kInterval).count();
  if (!due_.compare_exchange_strong(due, next) && !last) return;
  p.stage = stage_;
  p.fraction = risen_to(p.fraction);
  listener_.on_progress(p);
}

/// The work ahead is known better with every pass, but a fraction that was reported never falls.
double ProgressReporter::risen_to(double fraction) {
  double before = fraction_.load(std::memory_order_relaxed);
  while (before < fraction && !fraction_.compare_exchange_weak(before, fraction)) {
  }
  return std::max(before, fraction);
}

}  // namespace kiln::progress
