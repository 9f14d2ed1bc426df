#pragma once

#include <array>
#include <chrono>
#include <optional>

#include "baker/solver/pass.h"
#include "baker/solver/work.h"

namespace kiln::progress {

/// Estimates from the speed of a solver so far how long it will take. ahead() may be called from
/// any thread, the others while no batch runs.
class EtaEstimator {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param done by an earlier attempt, whose speed is not known
  explicit EtaEstimator(const solver::Work& done, Clock::time_point now = Clock::now())
      : start_(now), pass_start_(now), done_(done) {}

  /// @param share of the pass's batches that is done
  /// @param all that there is to do, as far as is known now
  struct Ahead {
    double share_done = 0;               ///< share of all work
    std::optional<double> seconds_left;  ///< nothing until enough has been done to tell
  };
  /// The pass that begins has this share of its batches from an earlier attempt.
  void resume_within(double share) { restored_ = share; }
  Ahead ahead(const solver::PassPlan&, double share, const solver::Work& all,
              Clock::time_point = Clock::now()) const;
  void end_pass(const solver::PassPlan&, Clock::time_point = Clock::now());

 private:
  using Rates = std::array<double, solver::Work::kKinds>;  ///< s per unit
  /// Work that has been timed.
  struct Timed {
    std::array<double, solver::Work::kKinds> seconds{}, work{};

    bool any() const;
    Rates rates() const;
    /// Adds `seconds` for `work`, shared out by the rates so far.
    void add(const solver::Work& work, double seconds);
  };

  Clock::time_point start_, pass_start_;
  solver::Work done_;    ///< passes that have ended
  double restored_ = 0;  ///< restored share of the pass under way
  Timed timed_;
};

}  // namespace kiln::progress
