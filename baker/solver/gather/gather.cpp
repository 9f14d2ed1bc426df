#include "baker/solver/gather/gather.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "baker/solver/direct/direct_pass.h"
#include "baker/solver/gather/passes.h"

namespace kiln::solver::gather {
namespace {

/// The least number of directions that feed the bounces.
constexpr std::uint32_t kMinFeedbackDirections = 16;

/// Returns how many directions feed the bounces, so that their hits fit into their memory.
std::uint32_t feedback_directions(const World& world, std::uint64_t budget_bytes) {
  const std::uint32_t wanted = world.plan.directions;
  const std::uint64_t affordable =
      budget_bytes / (sizeof(std::uint32_t) * std::max(1u, world.texels.size()));
  if (wanted <= affordable) return wanted;
  const std::uint64_t fitting = std::bit_floor(std::max<std::uint64_t>(1, affordable));
  return std::min(wanted, std::max(kMinFeedbackDirections, std::uint32_t(fitting)));
}

World with_first_directions(World world, std::uint32_t count) {
  world.plan.first_directions = count;
  return world;
}

class GatherSolver final : public Solver {
 public:
  GatherSolver(const World& world, std::uint64_t hit_budget_bytes)
      : world_(with_first_directions(world, feedback_directions(world, hit_budget_bytes))),
        parts_(world_, world_.plan.first_directions) {}

  std::vector<lightmap::PlaneSpec> state_planes() const override {
    using enum lightmap::PlaneId;
    std::vector<lightmap::PlaneSpec> planes{{kRadiosity}, {kGathers}};
    if (parts_.schedule.needs_rays()) planes.push_back({kHits, parts_.set.size()});
    return planes;
  }

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    const auto next = parts_.schedule.next(done);
    if (!next) return nullptr;
    PassPlan plan;
    plan.index = std::uint32_t(done.size());
    plan.completes = next->completes;
    plan.name = name_of(*next);
    plan.shows = shown_after(*next, plan.index);
    switch (next->step) {
      case Step::kDirect:
        return direct::make_direct_pass(world_, std::move(plan));
      case Step::kTrace:
        return make_trace_pass(parts_, std::move(plan));
      case Step::kRefine:
        return make_refine_pass(parts_, std::move(plan));
      case Step::kBounce:
        return make_bounce_pass(parts_, std::move(plan), next->bounce);
      case Step::kRound:
        return make_round_pass(parts_, std::move(plan));
    }
    return nullptr;
  }

  Forecast forecast() const override {
    return {parts_.schedule.max_passes(), parts_.schedule.total_work()};
  }
  const SamplePlan& samples() const override { return world_.plan; }
  std::string ray_pattern() const override {
    return parts_.schedule.needs_rays() ? parts_.packets.name() : "";
  }

 private:
  static const char* name_of(const Next& next) {
    switch (next.step) {
      case Step::kDirect:
        return "direct";
      case Step::kTrace:
        return "trace";
      case Step::kRefine:
        return "refine";
      case Step::kBounce:
        return next.bounce.stands_for_others ? "tail" : "bounce";
      case Step::kRound:
        return "round";
    }
    return "";
  }
  /// A coarse trace looks at the first bounce already; otherwise the first bounce itself shows it.
  Shows shown_after(const Next& next, std::uint32_t index) const {
    const GatherSchedule& schedule = parts_.schedule;
    const bool looks_ahead = schedule.is_coarse() && bounce_limit(world_.settings) > 0;
    if (next.completes) return Shows::kNothingNew;
    if (next.step == Step::kDirect) return Shows::kDirect;
    if (next.step == Step::kTrace) return looks_ahead ? Shows::kFirstBounce : Shows::kDirect;
    return index == schedule.first_bounce() ? Shows::kFirstBounce : Shows::kNothingNew;
  }

  const World world_;
  const GatherParts parts_;
};

}  // namespace

GatherParts::GatherParts(const World& w, std::uint32_t feedback)
    : world(w),
      grid(w.texels),
      packets(w, feedback),
      hemisphere(w, packets),
      set(directions(0, feedback)),
      emittance(sent_emittance(w)),
      sampling(w, w.plan),
      schedule(w, set, sampling) {}

sampling::DirectionSet GatherParts::directions(std::uint32_t first, std::uint32_t count) const {
  return {first, count, packets.sorts_directions(),
          world.settings.uses(proto::Technique::kLowDiscrepancy)};
}

std::unique_ptr<Solver> make_gather_solver(const World& world, std::uint64_t hit_budget_bytes) {
  return std::make_unique<GatherSolver>(world, hit_budget_bytes);
}

}  // namespace kiln::solver::gather
