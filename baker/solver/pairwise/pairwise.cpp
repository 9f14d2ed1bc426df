#include "baker/solver/pairwise/pairwise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "baker/solver/direct/direct_pass.h"
#include "baker/solver/direct/sky_pass.h"
#include "baker/solver/pairwise/parts.h"

namespace kiln::solver::pairwise {
namespace {

/// Rays of a batch, so that it takes some tens of milliseconds.
constexpr double kBatchRays = 400'000;

using lightmap::PlaneId;

/// Returns the expected rays of one bounce towards a texel.
double bounce_rays(const Parts& parts) {
  return kFacingShare * parts.senders.expected() * parts.patches.pair_samples();
}

class BouncePass final : public Pass {
 public:
  /// @param bounce from 0
  BouncePass(const Parts& parts, std::uint32_t bounce, PassPlan plan)
      : Pass(std::move(plan)), parts_(parts), bounce_(bounce) {
    plan_.reads = lightmap::plane_set({PlaneId::kDirect, PlaneId::kSky, PlaneId::kIndirect});
    plan_.writes = lightmap::plane_set({PlaneId::kIndirect});
    const double rays = bounce_rays(parts);
    plan_.work = Work::directions(rays);
    plan_.batch_texels = std::uint32_t(std::clamp(kBatchRays / rays, 1.0, 256.0));
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    radiosity_.resize(before.size());
    for (std::uint32_t t = 0; t < before.size(); ++t) {
      radiosity_[t] = parts_.reflectance(t) * before.irradiance(t);
      if (!parts_.emittance.empty()) radiosity_[t] += parts_.emittance[t];
    }
    if (parts_.senders.are_per_receiver()) return true;
    auto senders = parts_.senders.pick(radiosity_, bounce_, workers.stop);
    if (!senders) return false;
    senders_ = std::move(*senders);
    return true;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    Senders own;
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      Sums sums{};
      if (parts_.senders.are_per_receiver()) {
        std::uint32_t window = 0;
        do {
          window = parts_.senders.pick_for(i, radiosity_, bounce_, window, own);
          rays += add(i, own, sums);
        } while (window > 0);
      } else {
        rays += add(i, senders_, sums);
      }
      after.indirect[i] = {float(sums[0]), float(sums[1]), float(sums[2])};
    }
    return rays;
  }

 private:
  using Sums = std::array<double, 3>;

  /// Adds what some senders give to a texel. @return rays traced
  std::uint64_t add(std::uint32_t texel, const Senders& from, Sums& sums) const {
    return parts_.factors.row(texel, from, [&](std::uint32_t s, float factor) {
      const math::Rgb b = from.list[s].radiosity;
      sums[0] += double(factor * b.r);
      sums[1] += double(factor * b.g);
      sums[2] += double(factor * b.b);
    });
  }

  const Parts& parts_;
  const std::uint32_t bounce_;
  std::vector<math::Rgb> radiosity_;  ///< B of the texels in the pass before, lx
  Senders senders_;                   ///< of all receivers, unless each has its own
};

class PairwiseSolver final : public Solver {
 public:
  explicit PairwiseSolver(const World& world) : world_(world), parts_(world_) {}

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    const auto count = std::uint32_t(done.size());
    PassPlan plan;
    plan.index = count;
    if (count < first_bounce()) {
      plan.completes = bounces() == 0 && count + 1 == first_bounce();
      plan.name = count == 0 ? "direct" : "sky";
      return count == 0 ? direct::make_direct_pass(world_, std::move(plan))
                        : direct::make_sky_pass(world_, std::move(plan));
    }
    if (count - first_bounce() >= bounces()) return nullptr;
    if (count > first_bounce() && is_last(done.first(count - 1))) return nullptr;
    plan.name = "bounce";
    plan.completes = is_last(done);
    return std::make_unique<BouncePass>(parts_, count - first_bounce(), std::move(plan));
  }

  Forecast forecast() const override {
    Work work = direct::direct_work(world_);
    if (world_.scene.has_sky()) work += direct::sky_work(world_);
    work += Work::directions(bounce_rays(parts_)) * std::min(kTypicalBounces, bounces());
    return {first_bounce() + bounces(), work};
  }
  const SamplePlan& samples() const override { return world_.plan; }

 private:
  std::uint32_t first_bounce() const { return world_.scene.has_sky() ? 2 : 1; }
  /// Returns the most passes over the senders. One more brings the light of emitters that send it
  /// as any texel does.
  std::uint32_t bounces() const {
    return world_.settings.bounces + Parts::are_senders(world_.settings);
  }

  /// Returns whether the bounce that follows is the last one: the limit is reached, or the one
  /// after it would change the light by less than the tolerance, as the ratio of the last two says.
  bool is_last(std::span<const proto::PassReport> done) const {
    const std::size_t had = done.size() - first_bounce();
    if (had + 1 >= bounces()) return true;
    if (had < 2) return false;
    const double last = done.back().residual, before = done[done.size() - 2].residual;
    const double ratio = before > 0 ? last / before : 0;
    return ratio < 1 && last * ratio * ratio <= double(world_.settings.tolerance);
  }

  const World world_;
  const Parts parts_;
};

}  // namespace

std::uint32_t window_texels(const proto::SolverSettings& settings, std::uint32_t page_size) {
  return settings.window.value_or(std::max(1u, page_size / 128));
}

double pass_rays(double texels, std::uint32_t pair_samples, std::uint32_t window) {
  return texels * std::ceil(texels / (double(window) * window)) * pair_samples;
}

double pairwise_memory_per_texel(const proto::SolverSettings& settings) {
  const double emittance = Parts::are_senders(settings) ? sizeof(math::Rgb) : 0;
  return Patches::memory_per_texel(settings.pair_samples) +
         SenderStrategy::memory_per_texel(settings) + emittance;
}

std::unique_ptr<Solver> make_pairwise_solver(const World& world) {
  return std::make_unique<PairwiseSolver>(world);
}

}  // namespace kiln::solver::pairwise
