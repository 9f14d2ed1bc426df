#include "baker/solver/direct/sky_pass.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "baker/sampling/estimate.h"
#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"
#include "baker/solver/footprint.h"

namespace kiln::solver::direct {
namespace {

using lightmap::PlaneId;

class SkyPass final : public Pass {
 public:
  SkyPass(const World& world, PassPlan plan)
      : Pass(std::move(plan)), world_(world), shares_(sky_shares(world.plan)) {}

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    const std::uint32_t count = world_.plan.directions;
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      const sampling::Estimate sky = light_of(t, count, rays);
      after.sky[t] = sky.mean * (1 / float(count));
      after.sky_difference[t] = sky.half_difference / float(count);
      after.samples[t] = count;
    }
    return rays;
  }

 private:
  /// Returns the sums over the directions.
  sampling::Estimate light_of(std::uint32_t texel, std::uint32_t count, std::uint64_t& rays) const {
    const Footprint at(world_, texel);
    const std::uint32_t seed = texel_seed(world_, texel, SampleStream::kSky);
    sampling::HalfSums sums;
    trace::RayPacket packet;
    math::Rgb seen[16];
    for (std::uint32_t first = 0; first < count; first += 16) {
      packet.active = 0;
      for (std::uint32_t k = 0; k < std::min(16u, count - first); ++k) {
        const std::uint32_t i = (k ^ seed) % Footprint::kPoints;
        const math::Vec3 d =
            sampling::Frame(at.shading_normal[i])
                .to_world(sampling::cosine_direction(sampling::sample_pair(first + k, seed)));
        if (dot(d, at.geometric_normal[i]) <= 0) continue;
        seen[k] = radiance(d, dot(d, at.shading_normal[i]));
        if (is_black(seen[k])) continue;
        packet.set(k, at.origin[i], d, std::numeric_limits<float>::infinity());
        packet.active |= 1u << k;
        ++rays;
      }
      if (packet.active == 0) continue;
      const std::uint32_t open = packet.active & ~world_.rays.occluded(packet);
      for (std::uint32_t k = 0; k < 16; ++k)
        if (open >> k & 1) sums.half[k >> 3] += seen[k] * math::kPi;
    }
    return sums.estimate();
  }

  math::Rgb radiance(math::Vec3 direction, float cosine) const {
    if (!world_.lights.sky()) return world_.scene.sky;
    const light::SkyLight::Seen seen = world_.lights.sky()->seen(direction);
    return seen.radiance * shares_.of_cosine(seen.density, std::max(0.f, cosine));
  }

  const World& world_;
  const light::SkyShares shares_;
};

}  // namespace

std::unique_ptr<Pass> make_sky_pass(const World& world, PassPlan plan) {
  plan.writes = lightmap::plane_set({PlaneId::kSky, PlaneId::kSkyDifference, PlaneId::kSamples});
  plan.work = sky_work(world);
  return std::make_unique<SkyPass>(world, std::move(plan));
}

Work sky_work(const World& world) {
  return Work::directions(work::kDirection * world.plan.directions);
}

}  // namespace kiln::solver::direct
