#include "baker/exec/batch_queue.h"

#include "baker/exec/stop.h"

namespace kiln::exec {

proto::Expected<void> LocalQueue::run(std::span<const std::uint32_t> batches, BatchWork& work,
                                      const std::function<void(std::uint32_t)>& on_done,
                                      std::stop_token stop) {
  const bool whole =
      pool_.for_batches(std::uint32_t(batches.size()), std::move(stop), [&](std::uint32_t i) {
        work.run(batches[i]);
        if (on_done) on_done(batches[i]);
      });
  if (!whole) return canceled();
  return {};
}

}  // namespace kiln::exec
