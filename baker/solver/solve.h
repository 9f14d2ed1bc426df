#pragma once

#include <functional>
#include <memory>
#include <stop_token>
#include <vector>

#include "baker/exec/thread_pool.h"
#include "baker/solver/solver.h"
#include "proto/expected.h"

namespace kiln::baker {

/// Called while a solver runs.
struct SolveHooks {
  /// From pool threads: batches of the current pass that are done, and their number.
  std::function<void(const Pass&, std::uint32_t done, std::uint32_t total)> on_batch;
  /// After each pass, from the calling thread. The light is shared: it never changes afterwards.
  std::function<proto::Expected<void>(const Pass&, const proto::PassReport&,
                                      std::shared_ptr<const Lightmap>)>
      on_pass;
};

struct Solution {
  std::shared_ptr<const Lightmap> light;
  std::vector<proto::PassReport> passes;
  double tail_scale = 0;  ///< factor on the last update that stands for the bounces left out
};

std::unique_ptr<Solver> make_solver(const SolverInput&);

/// Runs the passes of a solver over all texels, batch by batch, to the end.
/// Errors: `canceled`, `internal` when a light is not finite, those of hooks.on_pass.
proto::Expected<Solution> solve(Solver&, const TextureGroup&, ThreadPool&, std::stop_token,
                                const SolveHooks& = {});

}  // namespace kiln::baker
