#pragma once

#include <memory>
#include <vector>

#include "baker/bake.h"
#include "baker/checkpoint/writer.h"
#include "baker/progress/eta.h"
#include "baker/progress/reporter.h"
#include "baker/solve.h"
#include "baker/solver/solver.h"

namespace kiln::baker {

/// Shares of a bake's time, for the progress bar: what comes before and after the solver.
inline constexpr double kImportedAt = 0.05, kSolvingFrom = 0.15, kSolvedAt = 0.92;

/// Connects a solve with the observer of its bake, its progress and its checkpoints.
class SolveSession {
 public:
  /// Reports to the observer what `start` already holds. All arguments outlive the session.
  /// @param reference the work of a reference that is made after the solve
  SolveSession(const BakeInput&, const solver::World&, const solver::Solver&,
               std::shared_ptr<const atlas::TextureGroup>, const solver::SolveStart& start,
               checkpoint::CheckpointWriter&, BakeObserver&, progress::ProgressReporter&,
               const solver::Work& reference = {});

  /// Returns the hooks for solve(). They refer to the session.
  SolveHooks hooks();
  /// Returns the hooks for the solve of a reference, after the bake's own: they report progress and
  /// nothing else.
  SolveHooks reference_hooks();

 private:
  void on_batch(const SolveProgress&);
  void on_pass(const solver::PassPlan&, const proto::PassReport&,
               std::shared_ptr<const lightmap::Lightmap>);
  /// Hands over the light of a pass, on the way from what was handed over before
  /// [Moreno-Fortuny 4.4.2].
  void show(lightmap::Lightmap, std::uint32_t pass);
  solver::PassProgress restore(const solver::Pass&, const lightmap::Lightmap& before,
                               lightmap::Lightmap& after);

  const BakeInput& input_;
  const solver::World& world_;
  const solver::Solver& solver_;
  const std::shared_ptr<const atlas::TextureGroup> texels_;
  checkpoint::CheckpointWriter& writer_;
  BakeObserver& observer_;
  progress::ProgressReporter& reporter_;
  std::vector<proto::PassReport> passes_;
  std::shared_ptr<const lightmap::Lightmap> shown_;  ///< what show() has handed over, if it fades
  double residual_ = 1;
  progress::EtaEstimator eta_;
  solver::Work elsewhere_;  ///< what there is to do, or was, beside the solve under way
};

}  // namespace kiln::baker
