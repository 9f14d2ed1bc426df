#include "baker/solver/pairwise/pairwise.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "baker/solver/bounces.h"
#include "baker/solver/direct/direct_pass.h"
#include "baker/solver/direct/sky_pass.h"
#include "baker/solver/pairwise/parts.h"

namespace kiln::solver::pairwise {
namespace {

/// Rays of a batch, so that it takes some tens of milliseconds.
constexpr double kBatchRays = 400'000;

using lightmap::PlaneId;

class BouncePass final : public Pass {
 public:
  BouncePass(const Parts& parts, PassPlan plan) : Pass(std::move(plan)), parts_(parts) {
    plan_.reads = lightmap::plane_set({PlaneId::kDirect, PlaneId::kSky, PlaneId::kIndirect});
    plan_.writes = lightmap::plane_set({PlaneId::kIndirect});
    const double rays =
        kFacingShare * pass_rays(parts.patches.size(), parts.patches.pair_samples());
    const double per_texel = rays / std::max(1u, parts.patches.size());
    plan_.work = Work::directions(per_texel);
    plan_.batch_texels = std::uint32_t(std::clamp(kBatchRays / per_texel, 1.0, 256.0));
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers&) override {
    radiosity_.resize(before.size());
    for (std::uint32_t t = 0; t < before.size(); ++t)
      radiosity_[t] = parts_.reflectance(t) * before.irradiance(t);
    return true;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    const auto sends = [&](std::uint32_t j) { return !is_black(radiosity_[j]); };
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      double sum[3] = {};
      rays += parts_.factors.row(i, 0, parts_.patches.size(), sends,
                                 [&](std::uint32_t j, float factor) {
                                   const math::Rgb b = radiosity_[j];
                                   sum[0] += double(factor * b.r);
                                   sum[1] += double(factor * b.g);
                                   sum[2] += double(factor * b.b);
                                 });
      after.indirect[i] = {float(sum[0]), float(sum[1]), float(sum[2])};
    }
    return rays;
  }

 private:
  const Parts& parts_;
  std::vector<math::Rgb> radiosity_;  ///< B of the pass before, lx
};

class PairwiseSolver final : public Solver {
 public:
  explicit PairwiseSolver(const World& world) : world_(world), parts_(world_) {}

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    const auto count = std::uint32_t(done.size());
    PassPlan plan;
    plan.index = count;
    if (count < first_bounce()) {
      plan.completes = world_.settings.bounces == 0 && count + 1 == first_bounce();
      plan.name = count == 0 ? "direct" : "sky";
      return count == 0 ? direct::make_direct_pass(world_, std::move(plan))
                        : direct::make_sky_pass(world_, std::move(plan));
    }
    if (count - first_bounce() >= world_.settings.bounces) return nullptr;
    if (count > first_bounce() && is_last(done.first(count - 1))) return nullptr;
    plan.name = "bounce";
    plan.completes = is_last(done);
    return std::make_unique<BouncePass>(parts_, std::move(plan));
  }

  Forecast forecast() const override {
    Work work = direct::direct_work(world_);
    if (world_.scene.has_sky()) work += direct::sky_work(world_);
    const std::uint32_t bounces = std::min(kTypicalBounces, world_.settings.bounces);
    const double rays = kFacingShare * pass_rays(1, world_.settings.pair_samples);
    work += Work::directions(rays * world_.texels.size()) * bounces;
    return {first_bounce() + world_.settings.bounces, work};
  }
  const SamplePlan& samples() const override { return world_.plan; }

 private:
  std::uint32_t first_bounce() const { return world_.scene.has_sky() ? 2 : 1; }

  bool is_last(std::span<const proto::PassReport> done) const {
    return is_last_bounce(world_.settings, done.subspan(first_bounce()));
  }

  const World world_;
  const Parts parts_;
};

}  // namespace

double pass_rays(double texels, std::uint32_t pair_samples) {
  return texels * texels * pair_samples;
}

double pairwise_memory_per_texel(std::uint32_t pair_samples) {
  return Patches::memory_per_texel(pair_samples) + sizeof(math::Rgb);
}

std::unique_ptr<Solver> make_pairwise_solver(const World& world) {
  return std::make_unique<PairwiseSolver>(world);
}

}  // namespace kiln::solver::pairwise
