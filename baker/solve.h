#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/denoise/filter_bank.h"
#include "baker/exec/batch_queue.h"
#include "baker/exec/thread_pool.h"
#include "baker/solver/solver.h"
#include "proto/expected.h"

namespace kiln::baker {

/// The progress of a solve within a pass.
struct SolveProgress {
  const solver::Pass& pass;
  std::uint32_t done = 0, total = 0;  ///< batches of the pass
  std::uint32_t max_passes = 0;       ///< limit of the whole solve
  solver::Work work;                  ///< expected work of the whole solve, as far as is known now
};

/// Called while a solver runs.
struct SolveHooks {
  /// Called after each batch, from any thread of the queue.
  std::function<void(const SolveProgress&)> on_batch;
  /// Called before each pass, from the calling thread.
  std::function<void(const solver::PassPlan&)> begin_pass;
  /// Called after each pass, from the calling thread. The light does not change afterwards, except
  /// for shared planes (lightmap::shared_planes): they change in the next pass that writes them.
  std::function<proto::Expected<void>(const solver::PassPlan&, const proto::PassReport&,
                                      std::shared_ptr<const lightmap::Lightmap>)>
      on_pass;
  /// A pass that takes longer is reported in parts, about this often.
  std::chrono::milliseconds part_time{10'000};
  /// Called from any thread of the queue, one call at a time. The texels before `progress.texels`
  /// are computed in `after`, and stay as they are until end_parts().
  std::function<void(const solver::PassPlan&, std::shared_ptr<const lightmap::Lightmap> after,
                     const solver::PassProgress&)>
      on_part;
  std::function<void()> end_parts;
  /// Called after a pass has been prepared. It puts what on_part() was given in an earlier attempt
  /// into `after`.
  std::function<solver::PassProgress(const solver::Pass&, const lightmap::Lightmap& before,
                                     lightmap::Lightmap& after)>
      restore;
  /// A stop request ends the solve with the light of the passes that are done; `canceled` when no
  /// pass is.
  std::stop_token finish_early;
  /// Runs the batches; null: the pool does, in place.
  exec::BatchQueue* queue = nullptr;
};

struct Solution {
  std::shared_ptr<const lightmap::Lightmap> light;  ///< as sampled
  denoise::FilteredLight filtered;                  ///< as shown
  std::vector<proto::PassReport> passes;
  double tail_scale = 0;    ///< see PassPlan::tail_scale
  std::string ray_pattern;  ///< see Solver::ray_pattern

  math::Rgb irradiance(std::uint32_t texel) const {
    return filtered.direct[texel] + filtered.sky[texel] + filtered.indirect[texel];
  }
};

/// Runs the passes of a solver over all texels, batch by batch, to the end. After each pass that
/// leaves the light complete, filters and judges it, and chooses what the next round of samples
/// adds (solver/adaptive). From any start that these passes led to, the light is the same bit by
/// bit, and so it is by any queue. Errors: `canceled`, `internal` when a light is not finite, those
/// of hooks.on_pass and of the queue.
proto::Expected<Solution> solve(const solver::World&, const solver::Solver&, exec::ThreadPool&,
                                std::stop_token, const SolveHooks& = {}, solver::SolveStart = {});

}  // namespace kiln::baker
