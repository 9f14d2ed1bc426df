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

/// Bytes per texel by which shooting sorts.
constexpr double kOrder = 8;

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
    const double rays = bounce_rays(parts_);
    if (remembers()) work += Work::directions(rays / 2);
    work += Work::directions(rays) * std::min(kTypicalBounces, bounces());
    return {lead() + bounces() * steps(), work};
  }
  const SamplePlan& samples() const override { return world_.plan; }

  std::vector<proto::Warning> remarks(std::span<const proto::PassReport>,
                                      const lightmap::Lightmap& light) const override {
    std::vector<proto::Warning> remarks;
    const double covered = PairLayout(parts_.patches.size(), parts_.seen_words()).coverage();
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
    return (size * ((size / 2 + 31) / 32) * sizeof(std::uint32_t) >> 20) + 1;
  }
  /// Says what share of all light the clamps have taken.
  std::string clamped(const lightmap::Lightmap& light) const {
    double lost = 0, left = 0;
    for (std::uint32_t t = 0; t < light.size(); ++t) {
      const double area = parts_.patches.area_m2(t);
      lost += area * double(light.clamped[t]);
      left += area * double(luminance(light.irradiance(t)));
    }
    return "The clamps of solver.max_contribution and solver.max_view_factor took " +
           percent(lost + left > 0 ? lost / (lost + left) : 0) +
           " of the light in the last bounce, apart from what earlier bounces lacked.";
  }

  Iteration iteration() const { return world_.settings.iteration; }
  bool remembers() const { return bounces() > 0 && parts_.seen_words() > 0; }
  /// Returns the passes before the first bounce.
  std::uint32_t lead() const { return 1 + world_.scene.has_sky() + remembers(); }
  /// Returns the most passes over the senders. One more brings the light of emitters that send it
  /// as any texel does.
  std::uint32_t bounces() const { return world_.settings.bounces + emitters_send(world_.settings); }
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

std::uint32_t batch_texels(const Parts& parts) {
  const double most = std::clamp(kBatchRays / bounce_rays(parts), 1.0, 256.0);
  return parts.world.settings.batch_texels.value_or(std::uint32_t(most));
}

std::uint32_t window_texels(const proto::SolverSettings& settings, std::uint32_t page_size) {
  return settings.window.value_or(std::max(1u, page_size / 128));
}

double pass_rays(double texels, std::uint32_t pair_samples, std::uint32_t window) {
  return texels * std::ceil(texels / (double(window) * window)) * pair_samples;
}

double pairwise_memory_per_texel(const proto::SolverSettings& settings) {
  const double emittance = emitters_send(settings) ? sizeof(math::Rgb) : 0;
  return Patches::memory_per_texel(settings.pair_samples) +
         SenderStrategy::memory_per_texel(settings) + emittance;
}

double pairwise_extra_memory(const proto::SolverSettings& s, double texels) {
  double bytes = 0;
  if (s.visibility == proto::VisibilityKind::kCached) {
    const auto words =
        PairLayout::words_for(std::uint32_t(texels), std::uint64_t(s.visibility_cache_mib) << 20);
    bytes += texels * words * sizeof(std::uint32_t);
  }
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
