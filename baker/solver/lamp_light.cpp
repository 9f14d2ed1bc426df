#include "baker/solver/lamp_light.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "baker/solver/sampling.h"
#include "baker/solver/sobol.h"

namespace kiln::baker {
namespace {

constexpr std::uint32_t kPoints = Footprint::kPoints;
/// Where the unoccluded light varies by more than this share over the footprint, each point has a
/// visible share of its own, from two packets on; elsewhere the whole texel has one, from more
/// rays.
constexpr float kEven = 0.1f;

/// What the shadow rays of a texel found, a lane per point.
class Tally {
 public:
  explicit Tally(const LampLight::View& view) : view_(view) {
    const auto [low, high] = std::minmax_element(view.irradiance, view.irradiance + kPoints);
    even_ = *high - *low <= kEven * view.mean;
  }

  void add(const RayPacket& rays, const LightRays& to, std::uint32_t blocked) {
    for (std::uint32_t i = 0; i < kPoints; ++i) {
      const float weight = rays.active >> i & 1 ? to.weight[i] : 0.f;
      sent_[i] += weight;
      arrived_[i] += blocked >> i & 1 ? 0.f : weight;
    }
    ++packets_;
  }

  float irradiance() const {
    float sent = 0, arrived = 0, sum = 0;
    for (std::uint32_t i = 0; i < kPoints; ++i) {
      sent += sent_[i], arrived += arrived_[i];
      if (sent_[i] > 0) sum += view_.irradiance[i] * (arrived_[i] / sent_[i]);
    }
    if (!view_.exact) return arrived / float(packets_ * kPoints);
    if (packets_ > 1 && !even_) return sum / kPoints;
    return sent > 0 ? view_.mean * (arrived / sent) : 0;
  }

 private:
  const LampLight::View& view_;
  bool even_ = true;
  float sent_[kPoints] = {}, arrived_[kPoints] = {};
  std::uint32_t packets_ = 0;
};

/// Samples of packet `p`. Each point takes a run of the sequence, a net by itself where it is a
/// power of two long; all runs together are the net of the whole texel.
void take_samples(std::uint32_t p, std::uint32_t packets, std::uint32_t (&x)[kPoints],
                  std::uint32_t (&y)[kPoints]) {
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const SobolPoint s = sobol(i * packets + p);
    x[i] = s.x, y[i] = s.y;
  }
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

float LampLight::irradiance(const AreaLight& light, const View& view, const Footprint& at,
                            const PointFrames& frames, std::uint32_t packets, std::uint32_t seed,
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
    take_samples(p, packets, x, y);
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
    tally.add(rays, to, rays.active != 0 ? in_.rays.occluded(rays) : 0);
    traced += std::uint64_t(std::popcount(rays.active));
  }
  return tally.irradiance();
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
