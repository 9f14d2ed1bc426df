#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <random>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/exec/batch_queue.h"
#include "baker/exec/stop.h"

namespace kiln::test {

/// A queue that lets nothing write in place: it computes all batches apart, in one shuffled order,
/// as bytes, and hands those in in another one, as a coordinator of several machines would.
class PatchQueue final : public exec::BatchQueue {
 public:
  PatchQueue(exec::ThreadPool& pool, std::uint32_t seed) : pool_(pool), random_(seed) {}

  std::uint64_t patches = 0, bytes = 0;  ///< that were handed in

  proto::Expected<void> run(std::span<const std::uint32_t> batches, exec::BatchWork& work,
                            const std::function<void(std::uint32_t)>& on_done,
                            std::stop_token stop) override {
    std::vector<std::uint32_t> order(batches.begin(), batches.end());
    std::ranges::shuffle(order, random_);
    std::vector<std::string> patch(order.size());
    const bool whole = pool_.for_batches(std::uint32_t(order.size()), stop, [&](std::uint32_t i) {
      patch[i] = work.compute(order[i]);
    });
    if (!whole) return exec::canceled();
    std::vector<std::uint32_t> arrival(order.size());
    for (std::uint32_t i = 0; i < arrival.size(); ++i) arrival[i] = i;
    std::ranges::shuffle(arrival, random_);
    for (const std::uint32_t i : arrival) {
      if (stop.stop_requested()) return exec::canceled();
      if (auto ok = work.take(order[i], patch[i]); !ok) return ok;
      ++patches, bytes += patch[i].size();
      if (on_done) on_done(order[i]);
    }
    return {};
  }

 private:
  exec::ThreadPool& pool_;
  std::mt19937 random_;
};

}  // namespace kiln::test
