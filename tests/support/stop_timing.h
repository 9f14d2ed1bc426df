#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <stop_token>
#include <thread>

#include "proto/expected.h"

namespace kiln::test {

using StopClock = std::chrono::steady_clock;

/// CPU time of this process, s.
inline double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

/// How long `work` goes on after a stop that comes `delay` after its start: what it computes, and a
/// tenth of the time that passes, since other programs may have the processors meanwhile. 0 when it
/// was done before, or failed for another reason. `work` takes a std::stop_token and returns an
/// Expected.
template <class Work>
double seconds_after_stop(Work work, StopClock::duration delay) {
  std::stop_source source;
  StopClock::time_point stopped;
  double stopped_cpu = 0;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(delay);
    stopped = StopClock::now();
    stopped_cpu = cpu_seconds();
    source.request_stop();
  });
  const auto result = work(source.get_token());
  const auto end = StopClock::now();
  const double end_cpu = cpu_seconds();
  stopper.join();
  if (result || result.error().code != proto::kCanceledCode) return 0;
  const double passed = std::chrono::duration<double>(end - stopped).count();
  return std::min(passed, end_cpu - stopped_cpu + passed / 10);
}

/// Stops `work` all along the time that it takes: each time it ends within a second.
template <class Work>
void expect_quick_stops(Work work) {
  constexpr int kStops = 10;
  const auto start = StopClock::now();
  const auto done = work({});
  ASSERT_TRUE(done) << done.error().message;
  const auto whole = StopClock::now() - start;
  double longest = 0;
  for (int i = 0; i < kStops; ++i)
    longest = std::max(longest, seconds_after_stop(work, whole * i / kStops));
  EXPECT_GT(longest, 0) << "no stop was seen";
  EXPECT_LT(longest, 1);
}

}  // namespace kiln::test
