#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <vector>

#include "baker/exec/thread_pool.h"
#include "baker/solver/solver.h"
#include "proto/expected.h"

namespace kiln::solver {

/// How far a pass has come.
struct PassProgress {
  std::uint32_t texels = 0;  ///< the first so many are done: whole batches
  std::uint64_t rays = 0;    ///< traced for them
  double seconds = 0;        ///< since the pass began
};

/// Called while a solver runs.
struct SolveHooks {
  /// From pool threads: batches of the current pass that are done, and their number.
  std::function<void(const Pass&, std::uint32_t done, std::uint32_t total)> on_batch;
  /// From the calling thread, before and after each pass. The light is shared: it never changes
  /// afterwards.
  std::function<void(const Pass&)> before_pass;
  std::function<proto::Expected<void>(const Pass&, const proto::PassReport&,
                                      std::shared_ptr<const lightmap::Lightmap>)>
      on_pass;
  /// A pass that takes longer is told of in parts, about this often.
  std::chrono::milliseconds part_time{10'000};
  /// From the calling thread: the texels before `progress.texels` are computed in `after`, and stay
  /// as they are until before_finish().
  std::function<void(const Pass&, std::shared_ptr<const lightmap::Lightmap> before,
                     std::shared_ptr<const lightmap::Lightmap> after, const PassProgress&)>
      on_part;
  std::function<void()> before_finish;
  /// After a pass has begun: puts what on_part() was told of an earlier attempt at it into `after`
  /// and the solver's state.
  std::function<PassProgress(const Pass&, const lightmap::Lightmap& before,
                             lightmap::Lightmap& after)>
      restore;
  /// A stop request ends the solve with the light of the passes that are done; `canceled` when no
  /// pass is.
  std::stop_token enough;
};

struct Solution {
  std::shared_ptr<const lightmap::Lightmap> light;  ///< as sampled
  denoise::FilteredLight filtered;                  ///< as shown
  std::vector<proto::PassReport> passes;
  double tail_scale = 0;    ///< see Pass::tail_scale
  std::string ray_pattern;  ///< see Solver::ray_pattern

  math::Rgb irradiance(std::uint32_t texel) const {
    return filtered.direct[texel] + filtered.sky[texel] + filtered.indirect[texel];
  }
};

/// Where a solve begins; by default in the dark, before the first pass.
struct SolveStart {
  std::vector<proto::PassReport> passes;            ///< that are done
  std::shared_ptr<const lightmap::Lightmap> light;  ///< after them; null before the first pass
};

/// Runs the passes of a solver over all texels, batch by batch, to the end. From any start that
/// these passes led to, with Solver::state() as they left it, the light is the same bit by bit.
/// Errors: `canceled`, `internal` when a light is not finite, those of hooks.on_pass.
proto::Expected<Solution> solve(Solver&, const atlas::TextureGroup&, exec::ThreadPool&,
                                std::stop_token, const SolveHooks& = {}, SolveStart = {});

}  // namespace kiln::solver
