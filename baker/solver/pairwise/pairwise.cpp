#include "baker/solver/pairwise/pairwise.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "baker/solver/bounces.h"
#include "baker/solver/direct/direct_pass.h"
#include "baker/solver/direct/lead_passes.h"
#include "baker/solver/direct/sky_pass.h"
#include "baker/solver/pairwise/passes.h"
#include "baker/solver/pairwise/transport_pass.h"
#include "baker/trace/voxel_grid.h"

namespace kiln::solver::pairwise {
namespace {

using proto::Iteration;

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g %%", 100 * share);
  return text;
}

/// Returns the words per texel that the memory for remembered visibility has, at most those that
/// all pairs need.
std::uint32_t words_for(const proto::SolverSettings& s, std::uint32_t texels) {
  return PairLayout::words_for(texels, std::uint64_t(s.visibility_cache_mib) << 20);
}
std::uint32_t all_words(std::uint32_t texels) {
  return PairLayout::words_for(texels, ~std::uint64_t{0});
}

/// Bytes per texel by which shooting sorts.
constexpr double kOrder = 8;

/// The effort of a pair whose bit is asked, in rays: a bounce without rays takes an eighth of one
/// with them, which are those of a quarter of all pairs.
constexpr double kAskPair = 0.03;
/// The least share of the texels that an estimate tells which there are.
constexpr double kLeastTexels = 0.5;

/// Rays of a batch, so that it takes some tens of milliseconds.
constexpr double kBatchRays = 400'000;

/// The passes, in order: direct light; the sky; what is seen, where that is remembered; then
/// bounces, each of as many steps as the iteration takes.
class PairwiseSolver final : public Solver {
 public:
  explicit PairwiseSolver(const World& world) : world_(world), parts_(world_) {}

  std::vector<lightmap::PlaneSpec> state_planes() const override {
    std::vector<lightmap::PlaneSpec> planes;
    if (iteration() == Iteration::kShooting) planes.push_back({lightmap::PlaneId::kRadiosity});
    if (remembers()) planes.push_back({lightmap::PlaneId::kSeen, parts_.seen_words()});
    if (world_.settings.max_contribution || world_.settings.max_view_factor)
      planes.push_back({lightmap::PlaneId::kClamped});
    return planes;
  }

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    const auto count = std::uint32_t(done.size());
    PassPlan plan;
    plan.index = count;
    plan.completes = bounces() == 0 && count + 1 == lead();
    if (count == 0) {
      plan.name = "direct";
      return direct::make_direct_pass(world_, std::move(plan));
    }
    if (count == 1 && world_.scene.has_sky()) {
      plan.name = "sky";
      return direct::make_sky_pass(world_, std::move(plan));
    }
    if (count + 1 == lead() && remembers()) {
      plan.name = "visibility";
      return make_seeing_pass(parts_, std::move(plan));
    }
    return next_step(done.subspan(lead()), std::move(plan));
  }

  Forecast forecast() const override {
    Work work = direct::lead_work(world_);
    if (remembers()) work += Work::directions(bounce_rays(parts_) / 2 * parts_.remembered_share());
    work += bounce_work(parts_) * std::min(kTypicalBounces, bounces());
    return {lead() + bounces() * steps(), work};
  }
  const SamplePlan& samples() const override { return world_.plan; }

  std::vector<proto::Warning> remarks(std::span<const proto::PassReport>,
                                      const lightmap::Lightmap& light) const override {
    std::vector<proto::Warning> remarks;
    const double covered = parts_.remembered_share();
    if (world_.settings.visibility == proto::VisibilityKind::kCached && covered < 1)
      remarks.push_back({"visibility_cache_full", "",
                         "The memory for visibility holds " + percent(covered) +
                             " of all pairs of texels; the others are traced in every bounce. All "
                             "of them take " +
                             std::to_string(mib_for_all_pairs()) + " MiB."});
    if (light.clamped.size() > 0) remarks.push_back({"energy_clamped", "", clamped(light)});
    return remarks;
  }

 private:
  std::uint64_t mib_for_all_pairs() const {
    const std::uint64_t size = parts_.patches.size();
    return (size * all_words(parts_.patches.size()) * sizeof(std::uint32_t) >> 20) + 1;
  }
  /// Says what share of all light the clamps have taken.
  std::string clamped(const lightmap::Lightmap& light) const {
    double lost = 0, left = 0;
    for (std::uint32_t t = 0; t < light.size(); ++t) {
      const double area = parts_.patches.area_m2(t);
      lost += area * double(light.clamped[t]);
      left += area * double(luminance(light.irradiance(t)));
    }
    const proto::SolverSettings& set = world_.settings;
    const std::string names = !set.max_view_factor ? "clamp of solver.max_contribution"
                              : !set.max_contribution
                                  ? "clamp of solver.max_view_factor"
                                  : "clamps of solver.max_contribution and solver.max_view_factor";
    return "The " + names + " took " + percent(lost + left > 0 ? lost / (lost + left) : 0) +
           " of the light in the last bounce, apart from what earlier bounces lacked.";
  }

  Iteration iteration() const { return world_.settings.iteration; }
  bool remembers() const { return bounces() > 0 && parts_.seen_words() > 0; }
  /// Returns the passes before the first bounce.
  std::uint32_t lead() const { return 1 + world_.scene.has_sky() + remembers(); }
  /// Returns the most passes over the senders.
  std::uint32_t bounces() const { return bounce_limit(world_.settings); }
  /// Returns the passes of a bounce.
  std::uint32_t steps() const {
    switch (iteration()) {
      case Iteration::kJacobi:
        break;
      case Iteration::kGaussSeidel:
        return kTiles;
      case Iteration::kShooting:
        return kShots;
    }
    return 1;
  }

  std::unique_ptr<Pass> next_step(std::span<const proto::PassReport> done, PassPlan plan) const {
    if (iteration() == Iteration::kShooting) return next_shot(done, std::move(plan));
    const auto bounce = std::uint32_t(done.size() / steps());
    const auto step = std::uint32_t(done.size() % steps());
    if (bounce >= bounces()) return nullptr;
    const std::vector<double> changes = changes_of(done);
    if (step == 0 && bounce > 0 && is_last(std::span(changes).first(bounce - 1))) return nullptr;
    plan.completes = step + 1 == steps() && is_last(changes);
    plan.name = iteration() == Iteration::kJacobi ? "bounce" : "tile";
    const std::uint64_t size = world_.texels.size();
    const atlas::TexelRange tile{std::uint32_t(size * step / steps()),
                                 std::uint32_t(size * (step + 1) / steps())};
    return make_bounce_pass(parts_, bounce, tile, remembers(), std::move(plan));
  }

  std::unique_ptr<Pass> next_shot(std::span<const proto::PassReport> done, PassPlan plan) const {
    if (!done.empty() && is_last_shot(done.first(done.size() - 1))) return nullptr;
    plan.completes = is_last_shot(done);
    plan.name = "shoot";
    return make_shooting_pass(parts_, remembers(), std::move(plan));
  }

  /// Returns the change of each bounce that is over: the sum over its steps.
  std::vector<double> changes_of(std::span<const proto::PassReport> done) const {
    std::vector<double> changes(done.size() / steps());
    for (std::size_t i = 0; i < changes.size() * steps(); ++i)
      changes[i / steps()] += done[i].residual;
    return changes;
  }

  /// Returns whether the bounce that follows is the last one.
  bool is_last(std::span<const double> changes) const {
    return is_last_bounce(changes, bounces(), double(world_.settings.tolerance));
  }
  /// The same for a shot. Those after it send less than it each, so that all texels together would
  /// change the light by less than kShots times its share.
  bool is_last_shot(std::span<const proto::PassReport> done) const {
    if (done.size() + 1 >= std::size_t(bounces()) * kShots) return true;
    return !done.empty() && done.back().residual * kShots <= double(world_.settings.tolerance);
  }

  const World world_;
  const Parts parts_;
};

}  // namespace

double bounce_rays(const Parts& parts) {
  return kFacingShare * parts.senders.expected() * parts.patches.pair_samples();
}

Work bounce_work(const Parts& parts) {
  const double covered = parts.remembered_share();
  return Work::directions(bounce_rays(parts) * (1 - covered)) +
         Work::other(kAskPair * parts.senders.expected() * covered);
}

std::uint32_t batch_texels(const Parts& parts) {
  const double most = std::clamp(kBatchRays / bounce_rays(parts), 1.0, 256.0);
  return parts.world.settings.batch_texels.value_or(std::uint32_t(most));
}

std::uint32_t window_texels(const proto::SolverSettings& settings, std::uint32_t page_size) {
  const std::uint32_t least = settings.undersampling != proto::Undersampling::kNone ? 2 : 1;
  return settings.window.value_or(std::max(least, page_size / 128));
}

proto::VisibilityKind visibility_kind(const proto::SolverSettings& s, std::uint32_t texels) {
  using enum proto::VisibilityKind;
  if (s.visibility != kAuto) return s.visibility;
  const bool has_single_pairs = s.method == proto::Method::kPairwise && s.pair_samples == 1 &&
                                s.undersampling == proto::Undersampling::kNone &&
                                !s.subdivision_threshold;
  return has_single_pairs && s.bounces > 0 && words_for(s, texels) == all_words(texels) ? kCached
                                                                                        : kRay;
}

double pass_rays(double texels, std::uint32_t pair_samples, std::uint32_t window) {
  return texels * std::ceil(texels / (double(window) * window)) * pair_samples;
}

double bake_rays(const proto::SolverSettings& s, double texels, std::uint32_t window,
                 double bounces) {
  const double pass = kFacingShare * pass_rays(texels, s.pair_samples, window);
  const auto count = std::uint32_t(texels);
  if (visibility_kind(s, count) != proto::VisibilityKind::kCached || bounces == 0)
    return bounces * pass;
  const double covered = PairLayout(count, words_for(s, count)).coverage();
  return covered * kFacingShare * texels * texels / 2 + (1 - covered) * bounces * pass;
}

double pairwise_memory_per_texel(const proto::SolverSettings& settings) {
  return Patches::memory_per_texel(settings.pair_samples) +
         SenderStrategy::memory_per_texel(settings) + sent_emittance_memory_per_texel(settings);
}

double pairwise_extra_memory(const proto::SolverSettings& s, double texels) {
  double bytes = 0;
  // The texels are an estimate: there may be fewer, whose pairs have a place where theirs have
  // none.
  const auto least = std::uint32_t(kLeastTexels * texels);
  if (visibility_kind(s, least) == proto::VisibilityKind::kCached)
    bytes += texels * words_for(s, std::uint32_t(texels)) * sizeof(std::uint32_t);
  if (s.visibility == proto::VisibilityKind::kVoxel)
    bytes += trace::VoxelGrid::memory(s.voxel_grid);
  if (s.iteration == Iteration::kShooting) bytes += texels * (sizeof(math::Rgb) + kOrder);
  if (Clamps::are_used(s)) bytes += texels * sizeof(float);
  return bytes;
}

std::unique_ptr<Solver> make_pairwise_solver(const World& world) {
  return std::make_unique<PairwiseSolver>(world);
}

}  // namespace kiln::solver::pairwise
