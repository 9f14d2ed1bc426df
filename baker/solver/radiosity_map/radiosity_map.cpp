#include "baker/solver/radiosity_map/radiosity_map.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "baker/solver/radiosity_map/step_pass.h"

namespace kiln::solver::radiosity_map {
namespace {

/// Most scenes have converged after this many bounces; for estimates of work only.
constexpr std::uint32_t kTypicalBounces = 10;
/// Orders of reflection whose missing shares are told one by one.
constexpr std::uint32_t kToldOrders = 6;

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g %%", 100 * share);
  return text;
}

/// Returns the mean albedo of the scene's surface.
double mean_albedo(const atlas::TextureGroup& texels) {
  double sum = 0, area = 0;
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    sum += double(texels.area_m2[t]) * double(luminance(texels.albedo[t]));
    area += double(texels.area_m2[t]);
  }
  return area > 0 ? sum / area : 0;
}

class AveragedSolver final : public Solver {
 public:
  explicit AveragedSolver(const World& world)
      : world_(world),
        parts_(world_, kept_directions(world.settings, world.plan, double(world.texels.size()))),
        steps_(averaged_steps(world.settings, world.plan, double(world.texels.size()))) {}

  std::vector<lightmap::PlaneSpec> state_planes() const override {
    if (parts_.kept.size() == 0) return {};
    return {{lightmap::PlaneId::kHits, parts_.kept.size()}};
  }

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    if (done.size() >= steps_.size() || has_met_target(done)) return nullptr;
    PassPlan plan;
    plan.index = std::uint32_t(done.size());
    return make_step_pass(parts_, std::move(plan), steps_[done.size()]);
  }

  Forecast forecast() const override {
    Forecast all{std::uint32_t(steps_.size()), {}};
    for (const Step& step : steps_) all.work += step_work(parts_, step);
    return all;
  }
  const SamplePlan& samples() const override { return world_.plan; }
  std::string ray_pattern() const override { return parts_.packets.name(); }

  std::vector<proto::Warning> remarks(std::span<const proto::PassReport> done,
                                      const lightmap::Lightmap&) const override {
    const auto ran = std::span(steps_).first(std::min(done.size(), steps_.size()));
    const std::vector<double> share = series_shares(ran, kToldOrders + 1);
    if (share[1] == 0) return {};
    // The light of emitters that send it as texels do is an order behind that of shadow rays.
    const std::uint32_t behind = emitters_send(world_.settings), first = 2 - behind;
    std::string orders;
    for (std::uint32_t k = first; k <= kToldOrders; ++k)
      orders += (k == first         ? ""
                 : k == kToldOrders ? " and "
                                    : ", ") +
                percent(1 - share[k + behind]);
    const double albedo = mean_albedo(world_.texels);
    return {{"series_short_of_light", "",
             "The averaged series misses " + orders + " of the light that was reflected " +
                 std::to_string(first) + " to " + std::to_string(kToldOrders) +
                 " times; in a closed room of this scene's mean albedo that is " +
                 percent(missing_share(ran, albedo, behind)) +
                 " of all light. solver.series \"unbiased\" misses none."}};
  }

 private:
  bool has_met_target(std::span<const proto::PassReport> done) const {
    return world_.plan.target_error > 0 && !done.empty() && done.back().standard_error &&
           *done.back().standard_error <= double(world_.plan.target_error);
  }

  const World world_;
  const Parts parts_;
  const std::vector<Step> steps_;
};

class UnbiasedSolver final : public Solver {
 public:
  explicit UnbiasedSolver(const World& world)
      : world_(world),
        parts_(world_, 0),
        beginning_(unbiased_beginning(world.settings, world.plan, world.scene.has_sky())) {}

  std::vector<lightmap::PlaneSpec> state_planes() const override {
    if (bounces() == 0) return {};
    return {{lightmap::PlaneId::kRadiosity}};
  }

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    PassPlan plan;
    plan.index = std::uint32_t(done.size());
    if (plan.index < beginning_.size())
      return make_step_pass(parts_, std::move(plan), beginning_[plan.index]);
    const auto bounce = std::uint32_t(plan.index - beginning_.size());
    if (bounce >= bounces()) return nullptr;
    if (bounce > 0 && is_last(done.first(done.size() - 1))) return nullptr;
    Step step = unbiased_bounce(world_.plan, bounce);
    step.completes = is_last(done);
    return make_step_pass(parts_, std::move(plan), step);
  }

  Forecast forecast() const override {
    Forecast all{std::uint32_t(beginning_.size()) + bounces(), {}};
    for (const Step& step : beginning_) all.work += step_work(parts_, step);
    all.work +=
        step_work(parts_, unbiased_bounce(world_.plan, 0)) * std::min(kTypicalBounces, bounces());
    return all;
  }
  const SamplePlan& samples() const override { return world_.plan; }
  std::string ray_pattern() const override { return parts_.packets.name(); }

 private:
  std::uint32_t bounces() const { return bounce_limit(world_.settings); }
  /// Returns whether the bounce that follows is the last one: the limit is reached, or the one
  /// after it would change the light by less than the tolerance, as the ratio of the last two says.
  bool is_last(std::span<const proto::PassReport> done) const {
    const std::size_t had = done.size() - beginning_.size();
    if (had + 1 >= bounces()) return true;
    if (had < 2) return false;
    const double last = done.back().residual, before = done[done.size() - 2].residual;
    const double ratio = before > 0 ? last / before : 0;
    return ratio < 1 && last * ratio * ratio <= double(world_.settings.tolerance);
  }

  const World world_;
  const Parts parts_;
  const std::vector<Step> beginning_;
};

}  // namespace

std::unique_ptr<Solver> make_radiosity_map_solver(const World& world) {
  if (world.settings.series == proto::Series::kUnbiased)
    return std::make_unique<UnbiasedSolver>(world);
  return std::make_unique<AveragedSolver>(world);
}

}  // namespace kiln::solver::radiosity_map
