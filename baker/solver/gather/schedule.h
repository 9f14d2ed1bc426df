#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "baker/solver/adaptive/adaptive_sampling.h"
#include "baker/solver/gather/bounce_plan.h"
#include "baker/solver/solver.h"

namespace kiln::solver::gather {

/// Which passes a gather makes, in which order, and what they are expected to cost: `direct`;
/// `trace`, and `refine` where light is gathered coarsely; a `bounce` for each reflection, the last
/// of which may be the `tail` that stands for those left out; then rounds of more samples.
class GatherSchedule {
 public:
  static constexpr const char* kDirect = "direct";
  static constexpr const char* kTrace = "trace";
  static constexpr const char* kRefine = "refine";
  static constexpr const char* kBounce = "bounce";
  static constexpr const char* kTail = "tail";
  static constexpr const char* kRound = adaptive::SampleRounds::kName;
  static bool is_bounce(const Pass& p) { return p.name == kBounce || p.name == kTail; }

  /// @param set the directions whose hits are remembered. All three outlive the schedule.
  GatherSchedule(const SolverInput&, const sampling::DirectionSet& set,
                 const adaptive::SampleRounds&);

  /// Whether there is anything to gather.
  bool needs_rays() const { return needs_rays_; }
  /// Passes before the first bounce.
  std::uint32_t first_bounce() const { return in_.plan.coarse ? 3 : 2; }

  std::uint32_t max_passes() const;
  Work total_work() const;
  std::optional<Pass> next(std::span<const proto::PassReport> done) const;

 private:
  std::optional<Pass> plan(std::span<const proto::PassReport> done) const;
  Pass plan_bounce(std::span<const proto::PassReport> done) const;
  Work direct_work() const;
  Work trace_work() const;
  Work refine_work() const { return directions_work(0.1); }
  Work directions_work(double share_of_texels) const;
  Work look_up_work(std::uint32_t directions) const;

  const SolverInput& in_;
  const sampling::DirectionSet& set_;
  const adaptive::SampleRounds& rounds_;
  const BouncePlan bounces_;
  const bool needs_rays_;
};

}  // namespace kiln::solver::gather
