#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "baker/solver/adaptive/rounds.h"
#include "baker/solver/gather/bounce_plan.h"
#include "baker/solver/pass.h"
#include "baker/solver/world.h"

namespace kiln::solver::gather {

/// The kinds of pass that a gather makes.
enum class Step { kDirect, kTrace, kRefine, kBounce, kRound };

/// The pass that follows.
struct Next {
  Step step = Step::kDirect;
  BouncePlan::Bounce bounce;  ///< set for a bounce only
  bool completes = false;
};

/// Decides which passes a gather makes, in which order, and what they are expected to cost:
/// `direct`; `trace`, and `refine` when light is gathered coarsely; a `bounce` for each reflection,
/// the last of which may be the `tail` that stands for those left out; then rounds of more samples.
class GatherSchedule {
 public:
  /// @param set the directions whose hits are kept. All three outlive the schedule.
  GatherSchedule(const World&, const sampling::DirectionSet& set,
                 const adaptive::AdaptiveSampling&);

  /// Returns whether there is anything to gather.
  bool needs_rays() const { return needs_rays_; }
  bool is_coarse() const { return world_.plan.coarse; }
  /// Returns the number of passes before the first bounce.
  std::uint32_t first_bounce() const { return is_coarse() ? 3 : 2; }

  std::uint32_t max_passes() const;
  /// Returns the work of all passes but rounds.
  Work total_work() const;
  std::optional<Next> next(std::span<const proto::PassReport> done) const;

  Work trace_work() const;
  Work refine_work() const { return directions_work(0.1); }
  Work look_up_work(std::uint32_t directions) const;

 private:
  std::optional<std::uint32_t> completed_after(std::span<const proto::PassReport> done) const;
  Work directions_work(double share_of_texels) const;

  const World& world_;
  const sampling::DirectionSet& set_;
  const adaptive::AdaptiveSampling& sampling_;
  const BouncePlan bounces_;
  const bool needs_rays_;
};

}  // namespace kiln::solver::gather
