#pragma once

#include <cstdint>
#include <span>

#include "baker/sampling/direction_set.h"
#include "baker/solver/emittance.h"
#include "proto/bake_settings.h"
#include "proto/manifest.h"

namespace kiln::solver::gather {

/// Decides how many bounces there are, and how many of the remembered hits each of them reads.
/// Every bounce carries on what the one before has changed; those changes form a geometric series.
class BouncePlan {
 public:
  /// @param set the directions whose hits are remembered; outlives the plan
  /// @param first passes before the first bounce
  BouncePlan(const proto::SolverSettings& settings, const sampling::DirectionSet& set,
             std::uint32_t first)
      : limit_(bounce_limit(settings)),
        tolerance_(settings.tolerance),
        set_(set),
        first_(first),
        lit_(first + emitters_send(settings)) {}

  struct Bounce {
    bool last = false;               ///< the limit is reached, or the light has converged
    bool stands_for_others = false;  ///< it is scaled by 1 + tail_scale, for those left out
    double tail_scale = 0;
    std::uint32_t directions = 0;  ///< the leading ones of the set, see DirectionSet::leading
  };
  /// @param done all passes so far; `first` of them or more
  Bounce next(std::span<const proto::PassReport> done) const;

  std::uint32_t limit() const { return limit_; }
  /// Returns whether the limit is reached.
  bool is_complete(std::span<const proto::PassReport> done) const {
    return done.size() - first_ == limit_;
  }
  /// Returns how many directions a bounce reads that brings such a share of the light. The smaller
  /// the share, the fewer directions are needed.
  std::uint32_t directions_for(double share) const;

 private:
  void end_if_converged(double residual, double ratio, std::uint32_t left, Bounce&) const;

  std::uint32_t limit_;
  double tolerance_;
  const sampling::DirectionSet& set_;
  std::uint32_t first_;
  std::uint32_t lit_;  ///< passes until all light that is not reflected is there
};

}  // namespace kiln::solver::gather
