#include "server/base/cpu_meter.h"

#include <gtest/gtest.h>

#include <chrono>
#include <optional>

namespace kiln::base {
namespace {

TEST(CpuMeter, SharesTheTimeAmongThoseWhoRun) {
  double now = 100;
  CpuMeter meter([&] { return now; });
  now = 110;  // nobody ran
  std::optional<CpuMeter::Run> a(meter), b;
  now = 114;
  EXPECT_DOUBLE_EQ(a->seconds(), 4);
  b.emplace(meter);
  now = 120;
  EXPECT_DOUBLE_EQ(a->seconds(), 7);
  EXPECT_DOUBLE_EQ(b->seconds(), 3);
  a.reset();
  now = 122;
  EXPECT_DOUBLE_EQ(b->seconds(), 5);
}

TEST(CpuMeter, LeavesOutWhatWasNotTheJobs) {
  double now = 100;
  CpuMeter meter([&] { return now; });
  const CpuMeter::Run run(meter);
  now = 110;
  meter.leave_out(3);
  EXPECT_DOUBLE_EQ(run.seconds(), 7);
  meter.leave_out(2);  // which the run has been given already
  now = 111;
  EXPECT_DOUBLE_EQ(run.seconds(), 7) << "never less";
  now = 115;
  EXPECT_DOUBLE_EQ(run.seconds(), 10);
}

TEST(CpuMeter, ReadsTheClockOfTheProcess) {
  CpuMeter meter;
  const CpuMeter::Run run(meter);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (run.seconds() < 0.05 && std::chrono::steady_clock::now() < end) {
  }
  EXPECT_GE(run.seconds(), 0.05);
  EXPECT_LT(run.seconds(), 20);
}

}  // namespace
}  // namespace kiln::base
