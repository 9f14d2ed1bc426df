#include "baker/solver/lamp_light.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "baker/solver/sampling.h"
#include "baker/solver/sobol.h"

namespace kiln::baker {
namespace {

constexpr std::uint32_t kPoints = Footprint::kPoints;

/// What the shadow rays of a texel found, in two halves.
class Tally {
 public:
  explicit Tally(const LampLight::View& view) : view_(view) {}

  /// @param second bits of the points whose ray belongs to the second half
  void add(const RayPacket& rays, const LightRays& to, std::uint32_t blocked,
           std::uint32_t second) {
    for (std::uint32_t i = 0; i < kPoints; ++i) {
      const float weight = rays.active >> i & 1 ? to.weight[i] : 0.f;
      Sums& half = half_[second >> i & 1];
      half.sent += weight;
      half.arrived += blocked >> i & 1 ? 0.f : weight;
      half.rays += 1;
    }
  }

  LampLight::Arrived arrived() const {
    const Sums &a = half_[0], &b = half_[1];
    const Sums all{a.sent + b.sent, a.arrived + b.arrived, a.rays + b.rays};
    return {irradiance(all), (irradiance(a) - irradiance(b)) / 2};
  }

 private:
  struct Sums {
    float sent = 0, arrived = 0, rays = 0;
  };
  float irradiance(const Sums& s) const {
    if (!view_.exact) return s.arrived / s.rays;
    return s.sent > 0 ? view_.mean * (s.arrived / s.sent) : 0;
  }

  const LampLight::View& view_;
  Sums half_[2];
};

/// Samples of packet `p` of those after the `first`. Each point takes a run of the sequence, a net
/// by itself where it is a power of two long; all runs together are the net of the whole texel.
void take_samples(std::uint32_t first, std::uint32_t p, std::uint32_t packets,
                  std::uint32_t (&x)[kPoints], std::uint32_t (&y)[kPoints]) {
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const SobolPoint s = sobol(first * kPoints + i * packets + p);
    x[i] = s.x, y[i] = s.y;
  }
}

/// Lanes of packet `p` whose rays belong to the second half. It has half of every point's run: the
/// last half of the one run, the first of another, by a bit of the run's number, which makes each
/// half a net of its own but for a factor of two (t = 1).
std::uint32_t second_half(std::uint32_t p, std::uint32_t packets, std::uint32_t flip) {
  // Of a single packet, the halves are those of the sequence.
  const std::uint32_t bit = packets > 1 ? 4 : 8;
  const bool late = packets > 1 && p >= packets / 2;
  std::uint32_t lanes = 0;
  for (std::uint32_t i = 0; i < kPoints; ++i)
    lanes |= std::uint32_t((((i ^ flip) & bit) != 0) != late) << i;
  return lanes;
}

}  // namespace

LampLight::View LampLight::view(const AreaLight& light, const Footprint& at,
                                const PointFrames& frames) const {
  // Below this size against the distance the closed form loses digits, and the light is as good
  // as constant over the lamp anyway.
  constexpr float kSmall = 0.02f;
  View view;
  LightView seen;
  kernels_.view_light(light.shape(), frames, seen);
  view.exact = light.longest_edge_m >= kSmall * light.least_distance(at.position[0]);
  float sum = 0;
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    view.irradiance[i] = 0;
    if (!light.shows_to(light.height_over(at.position[i]))) continue;
    view.irradiance[i] = seen.irradiance[i];
    if (seen.lowest[i] < 0)
      view.irradiance[i] = polygon_irradiance(at.position[i], at.shading_normal[i],
                                              at.geometric_normal[i], light.outline());
    sum += view.irradiance[i];
  }
  view.mean = sum / kPoints;
  return view;
}

LampLight::Arrived LampLight::arrive(const AreaLight& light, const View& view, const Footprint& at,
                                     const PointFrames& frames, std::uint32_t first,
                                     std::uint32_t packets, std::uint32_t seed,
                                     std::uint64_t& traced) const {
  const LightShape shape = light.shape();
  const float clearance = light.clearance(at.position[0]);
  const bool near = LightSet::is_near(light, at.position[0]);
  const std::uint32_t flip = hash(seed, 2) % kPoints, seed_y = hash(seed);
  Tally tally(view);
  RayPacket rays;
  LightRays to;
  std::memcpy(rays.org_x, frames.origin[0], sizeof rays.org_x);
  std::memcpy(rays.org_y, frames.origin[1], sizeof rays.org_y);
  std::memcpy(rays.org_z, frames.origin[2], sizeof rays.org_z);
  std::fill_n(rays.t_far, kPoints, 1.f);
  for (std::uint32_t p = 0; p < packets; ++p) {
    std::uint32_t x[kPoints], y[kPoints];
    take_samples(first, p, packets, x, y);
    if (near)
      near_rays(light, at, x, y, flip, seed, to);
    else
      kernels_.sample_light(shape, x, y, flip, seed, seed_y, frames, clearance, to);
    rays.active = 0;
    for (std::uint32_t i = 0; i < kPoints; ++i)
      rays.active |= std::uint32_t(to.weight[i] > 0 && view.irradiance[i] > 0) << i;
    std::memcpy(rays.dir_x, to.direction[0], sizeof rays.dir_x);
    std::memcpy(rays.dir_y, to.direction[1], sizeof rays.dir_y);
    std::memcpy(rays.dir_z, to.direction[2], sizeof rays.dir_z);
    const std::uint32_t blocked = rays.active != 0 ? in_.rays.occluded(rays) : 0;
    tally.add(rays, to, blocked, second_half(p, packets, flip));
    traced += std::uint64_t(std::popcount(rays.active));
  }
  return tally.arrived();
}

void LampLight::near_rays(const AreaLight& light, const Footprint& at, const std::uint32_t* x,
                          const std::uint32_t* y, std::uint32_t flip, std::uint32_t seed,
                          LightRays& to) const {
  const float unit = luminance(light.radiance);
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const Vec2 u = scrambled({x[i ^ flip], y[i ^ flip]}, seed);
    const LightSample s = in_.lights.sample(light, at.position[i], u);
    const Vec3 d = s.shadow_ray(at.origin[i]).direction;
    to.direction[0][i] = d.x, to.direction[1][i] = d.y, to.direction[2][i] = d.z;
    const bool above = dot(at.geometric_normal[i], s.direction) > 0;
    const float cosine = std::max(0.f, dot(at.shading_normal[i], s.direction));
    to.weight[i] = above && unit > 0 ? luminance(s.value) * cosine / unit : 0.f;
  }
}

}  // namespace kiln::baker
