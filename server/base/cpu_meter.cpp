#include "server/base/cpu_meter.h"

#include <sys/resource.h>

#include <utility>

namespace kiln::base {
namespace {

double seconds_of(const timeval& time) {
  return double(time.tv_sec) + double(time.tv_usec) / 1e6;
}

}  // namespace

double CpuMeter::process_seconds() {
  double total = 0;
  for (const auto who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage usage{};
    if (::getrusage(who, &usage) == 0)
      total += seconds_of(usage.ru_utime) + seconds_of(usage.ru_stime);
  }
  return total;
}

CpuMeter::CpuMeter(std::function<double()> clock) : clock_(std::move(clock)) {}

// The time that was used since the last look belongs to the jobs that ran since then: shares
// change whenever a job begins or ends.
void CpuMeter::share() {
  const double now = clock_();
  if (now < seen_) return;  // more was left out than has been used since
  const double used = now - seen_;
  seen_ = now;
  for (auto& [id, seconds] : shares_) seconds += used / double(shares_.size());
}

void CpuMeter::leave_out(double seconds) {
  const std::lock_guard lock(mutex_);
  seen_ += seconds;
}

CpuMeter::Run::Run(CpuMeter& meter) : meter_(meter) {
  const std::lock_guard lock(meter_.mutex_);
  meter_.share();
  id_ = meter_.next_++;
  meter_.shares_[id_] = 0;
}

CpuMeter::Run::~Run() {
  const std::lock_guard lock(meter_.mutex_);
  meter_.share();
  meter_.shares_.erase(id_);
}

double CpuMeter::Run::seconds() const {
  const std::lock_guard lock(meter_.mutex_);
  meter_.share();
  return meter_.shares_.at(id_);
}

}  // namespace kiln::base
