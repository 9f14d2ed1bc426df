#include "baker/solver/direct/direct_pass.h"

#include <utility>

#include "baker/solver/direct/direct.h"

namespace kiln::solver::direct {
namespace {

using lightmap::PlaneId;

class DirectPass final : public Pass {
 public:
  DirectPass(const World& world, PassPlan plan)
      : Pass(std::move(plan)), world_(world), light_(world) {}

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    const std::uint32_t count = world_.plan.shadow_rays;
    return light_.run(range, 0, count, [&](std::uint32_t t, const sampling::Estimate& e) {
      after.direct[t] = e.mean;
      after.direct_difference[t] = e.half_difference;
      after.direct_samples[t] = count;
    });
  }

 private:
  const World& world_;
  const DirectLight light_;
};

}  // namespace

std::unique_ptr<Pass> make_direct_pass(const World& world, PassPlan plan) {
  plan.writes =
      lightmap::plane_set({PlaneId::kDirect, PlaneId::kDirectDifference, PlaneId::kDirectSamples});
  plan.work = direct_work(world);
  return std::make_unique<DirectPass>(world, std::move(plan));
}

Work direct_work(const World& world) {
  const bool many = DirectLight::are_many(world.lights);
  const double ray = many ? work::kManyLightsRay : work::kUnculledShare;
  const double area = world.lights.area().empty() ? 0 : ray;
  const double sky = world.lights.has_bright_sky() ? 1 : 0;
  const double punctual =
      double(world.lights.punctual().size()) * atlas::TextureGroup::kPointsPerTexel;
  return Work::shadow_rays((area + sky) * world.plan.shadow_rays + punctual);
}

}  // namespace kiln::solver::direct
