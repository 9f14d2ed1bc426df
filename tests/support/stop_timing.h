#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <stop_token>
#include <thread>

#include "proto/expected.h"

namespace kiln::test {

using StopClock = std::chrono::steady_clock;

/// How long `work` goes on after a stop that comes `delay` after its start; 0 when it was done
/// before, or failed for another reason. `work` takes a std::stop_token and returns an Expected.
template <class Work>
double seconds_after_stop(Work work, StopClock::duration delay) {
  std::stop_source source;
  StopClock::time_point stopped;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(delay);
    stopped = StopClock::now();
    source.request_stop();
  });
  const auto result = work(source.get_token());
  const auto end = StopClock::now();
  stopper.join();
  if (result || result.error().code != proto::kCanceledCode) return 0;
  return std::chrono::duration<double>(end - stopped).count();
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
