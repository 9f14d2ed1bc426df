#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/lightmap/planes.h"
#include "baker/solver/pass.h"
#include "baker/solver/work.h"
#include "baker/solver/world.h"
#include "proto/manifest.h"

namespace kiln::solver {

/// The expected passes of a method, without the rounds that a target asks for.
struct Forecast {
  std::uint32_t passes = 0;  ///< at most, with all rounds
  Work work;                 ///< work of all passes but rounds
};

/// The light after some passes: a solve begins with it, and a checkpoint holds it. The default is
/// the dark before the first pass.
struct SolveStart {
  std::vector<proto::PassReport> passes;  ///< the passes that are done
  /// The light after them; null before the first pass.
  std::shared_ptr<const lightmap::Lightmap> light;
};

/// One light-transport method: the planes that it needs, and the order of its passes. It has no
/// state of its own and is the same in every process; passes hand everything on in the light.
class Solver {
 public:
  virtual ~Solver() = default;
  /// Returns the planes of the light beside those that every method has.
  virtual std::vector<lightmap::PlaneSpec> state_planes() const { return {}; }
  /// Returns the pass after those reported, or null when the light has converged or the limit is
  /// reached. A pass refers to its solver, which outlives it.
  virtual std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const = 0;
  virtual Forecast forecast() const = 0;
  /// Returns how many samples the passes before the first round take, and how many rounds may add.
  virtual const SamplePlan& samples() const = 0;
  /// Returns what a reader of the result should know of the light after these passes.
  virtual std::vector<proto::Warning> remarks(std::span<const proto::PassReport> /*done*/,
                                              const lightmap::Lightmap& /*light*/) const {
    return {};
  }
  /// Returns how gathered rays are put into packets, see PacketLayout; empty when none are.
  virtual std::string ray_pattern() const { return {}; }
};

}  // namespace kiln::solver
