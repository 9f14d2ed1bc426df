#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "baker/lightmap/planes.h"
#include "baker/solver/pass.h"
#include "baker/solver/work.h"
#include "baker/solver/world.h"
#include "proto/manifest.h"

namespace kiln::solver {

/// What is expected of the passes of a method, without the rounds that a target asks for.
struct Forecast {
  std::uint32_t passes = 0;  ///< at most, with all rounds
  Work work;                 ///< of all passes but rounds
};

/// The light after some passes: where a solve begins, and what a checkpoint holds. By default the
/// dark before the first pass.
struct SolveStart {
  std::vector<proto::PassReport> passes;            ///< that are done
  std::shared_ptr<const lightmap::Lightmap> light;  ///< after them; null before the first pass
};

/// One light-transport method: the planes that it needs, and the order of its passes. A description
/// without a state of its own, the same in every process; all that passes hand on is in the light.
class Solver {
 public:
  virtual ~Solver() = default;
  /// Planes of the light beside those that every method has.
  virtual std::vector<lightmap::PlaneSpec> state_planes() const { return {}; }
  /// The pass after those reported, or null when the light has converged or the limit is reached. A
  /// pass refers to its solver, which outlives it.
  virtual std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const = 0;
  virtual Forecast forecast() const = 0;
  /// How many samples the passes before the first round take, and how many rounds may add.
  virtual const SamplePlan& samples() const = 0;
  /// How gathered rays are put into packets, see PacketLayout; empty where none are.
  virtual std::string ray_pattern() const { return {}; }
};

}  // namespace kiln::solver
