#include "baker/solver/directional/directional.h"

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include "baker/solver/direct/lead_passes.h"
#include "baker/solver/directional/radiosity_mips.h"
#include "baker/solver/directional/ring_order.h"
#include "baker/solver/directional/tile_rays.h"

namespace kiln::solver::directional {
namespace {

using enum lightmap::PlaneId;

/// Rays of a batch, so that it takes some tens of milliseconds.
constexpr std::uint32_t kBatchRays = 200'000;
/// Most scenes have converged after this many bounces; for the estimate of progress only.
constexpr std::uint32_t kTypicalBounces = 10;

sampling::HemisphereSet make_set(const World& world) {
  const std::uint32_t count =
      std::min(world.plan.directions, proto::SolverSettings::kMostDirections);
  if (world.settings.direction_set == proto::DirectionSetKind::kHemicube)
    return sampling::hemicube_directions(count);
  return sampling::disc_directions(
      count, world.settings.seed,
      world.settings.rtrad_compat ? sampling::DiscRule::kAsPrinted : sampling::DiscRule::kCells);
}

/// RTRad's program lets emitters take no light.
bool takes_light(const World& world, std::uint32_t texel) {
  return !world.settings.rtrad_compat || !is_emissive(world.scene, world.texels.triangle[texel]);
}

class BouncePass final : public Pass {
 public:
  BouncePass(const World& world, const RingOrder& order, std::span<const math::Rgb> emittance,
             PassPlan plan)
      : Pass(std::move(plan)),
        world_(world),
        emittance_(emittance),
        rays_(world, order, radiosity_),
        count_(order.set.size()) {
    plan_.reads = lightmap::plane_set({kDirect, kSky, kIndirect, kValidity});
    plan_.writes = lightmap::plane_set({kIndirect, kIndirectDifference, kValidity, kSamples});
    plan_.work = bounce_work(count_);
    plan_.batch_texels =
        std::clamp(kBatchRays / count_ / TileRays::kTexels, 1u, 16u) * TileRays::kTexels;
  }

  static Work bounce_work(std::uint32_t directions) {
    return Work::directions(work::kDirection * directions);
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    return radiosity_.read(world_, before, emittance_, workers);
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    for (std::uint32_t first = range.begin; first < range.end; first += TileRays::kTexels) {
      const std::uint32_t count = std::min(TileRays::kTexels, range.end - first);
      const auto all = rays_.follow(first, count);
      for (std::uint32_t i = 0; i < count; ++i) {
        const std::uint32_t t = first + i;
        const bool takes = takes_light(world_, t);
        after.indirect[t] = takes ? all[i].light.mean : math::Rgb{};
        after.indirect_difference[t] = takes ? all[i].light.half_difference : 0;
        after.validity[t] = all[i].visible;
        after.samples[t] = count_;
      }
    }
    return std::uint64_t(range.size()) * count_;
  }

 private:
  const World& world_;
  const std::span<const math::Rgb> emittance_;
  RadiosityMips radiosity_;
  const TileRays rays_;
  const std::uint32_t count_;  ///< directions
};

class DirectionalSolver final : public Solver {
 public:
  explicit DirectionalSolver(const World& world)
      : world_(world),
        passes_(world_),
        order_(make_set(world)),
        emittance_(sent_emittance(world_)) {}

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    return direct::next_pass(world_, passes_, done, [&](PassPlan plan) {
      return std::make_unique<BouncePass>(world_, order_, emittance_, std::move(plan));
    });
  }

  Forecast forecast() const override {
    const std::uint32_t bounces = std::min(kTypicalBounces, passes_.bounces());
    return {passes_.most(),
            direct::lead_work(world_) + BouncePass::bounce_work(order_.set.size()) * bounces};
  }
  const SamplePlan& samples() const override { return world_.plan; }

 private:
  const World world_;
  const BouncePasses passes_;
  const RingOrder order_;
  const std::vector<math::Rgb> emittance_;  ///< M of the texels, lx; empty when rays find it
};

}  // namespace

double directional_memory_per_texel(const proto::SolverSettings& settings) {
  return RadiosityMips::kMemoryPerTexel + sent_emittance_memory_per_texel(settings);
}

std::unique_ptr<Solver> make_directional_solver(const World& world) {
  return std::make_unique<DirectionalSolver>(world);
}

}  // namespace kiln::solver::directional
