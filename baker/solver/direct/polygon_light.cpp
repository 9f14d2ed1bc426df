#include "baker/solver/direct/polygon_light.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "baker/sampling/estimate.h"
#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"

namespace kiln::solver::direct {
namespace {

constexpr std::uint32_t kPoints = Footprint::kPoints;
/// The ratio for LightSet::is_near(). Nearer lamps are sampled as the light set does, others
/// uniformly in area, sixteen points at once. That adds little noise (4 % in the half-shadows of a
/// room), since the rays only estimate a share.
constexpr float kNearLamp = 4;

}  // namespace

PolygonLight::View PolygonLight::view(const light::AreaLight& light, const Footprint& at,
                                      const simd::PointFrames& frames, std::uint32_t points) const {
  // Below this size against the distance the closed form loses digits, and the light is as good
  // as constant over the lamp anyway.
  constexpr float kSmall = 0.02f;
  View view;
  simd::LightView seen;
  kernels_.view_light(light.shape(), frames, seen);
  view.exact = light.longest_edge_m >= kSmall * light.least_distance(at.position[0]);
  float sum = 0;
  for (std::uint32_t i = 0; i < points; ++i) {
    view.irradiance[i] = 0;
    if (!light.shows_to(light.height_over(at.position[i]))) continue;
    view.irradiance[i] = seen.irradiance[i];
    if (seen.lowest[i] < 0)
      view.irradiance[i] = sampling::polygon_irradiance(at.position[i], at.shading_normal[i],
                                                        at.geometric_normal[i], light.outline());
    sum += view.irradiance[i];
  }
  view.mean = sum / float(points);
  return view;
}

PolygonLight::Shadow::Shadow(const PolygonLight& all, const light::AreaLight& light,
                             const View& view, const Footprint& at, const simd::PointFrames& frames,
                             std::uint32_t first, std::uint32_t packets, std::uint32_t seed)
    : all_(all),
      light_(light),
      view_(view),
      at_(at),
      frames_(frames),
      first_(first),
      packets_(packets),
      seed_(seed),
      flip_(sampling::hash(seed, 2) % kPoints),
      near_(light::LightSet::is_near(light, at.position[0], kNearLamp)) {}

std::uint64_t PolygonLight::Shadow::send_until(std::uint32_t end) {
  const simd::LightShape shape = light_.shape();
  const float clearance = light_.clearance(at_.position[0]);
  std::uint64_t traced = 0;
  trace::RayPacket rays;
  simd::LightRays to;
  std::memcpy(rays.org_x, frames_.origin[0], sizeof rays.org_x);
  std::memcpy(rays.org_y, frames_.origin[1], sizeof rays.org_y);
  std::memcpy(rays.org_z, frames_.origin[2], sizeof rays.org_z);
  std::fill_n(rays.t_far, kPoints, 1.f);
  for (; next_ < end; ++next_) {
    take_samples();
    if (near_)
      near_rays(to);
    else
      all_.kernels_.sample_light(shape, x_, y_, flip_, seed_, sampling::hash(seed_), frames_,
                                 clearance, to);
    rays.active = 0;
    for (std::uint32_t i = 0; i < kPoints; ++i)
      rays.active |= std::uint32_t(to.weight[i] > 0 && view_.irradiance[i] > 0) << i;
    std::memcpy(rays.dir_x, to.direction[0], sizeof rays.dir_x);
    std::memcpy(rays.dir_y, to.direction[1], sizeof rays.dir_y);
    std::memcpy(rays.dir_z, to.direction[2], sizeof rays.dir_z);
    add(rays, to, rays.active != 0 ? all_.world_.rays.occluded(rays) : 0);
    traced += std::uint64_t(std::popcount(rays.active));
  }
  return traced;
}

/// Each point takes a run of the sequence, which is a net by itself when it is a power of two long;
/// all runs together are the net of the whole texel. A packet takes another place in each run, so
/// that the rays of every packet spread over the lamp.
///
/// The second half has half of every run: the last half of one run, the first of another, by two
/// bits of the run's number, so that both spread over footprint and lamp. The halves of a single
/// packet are those of the sequence.
void PolygonLight::Shadow::take_samples() {
  second_ = 0;
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const std::uint32_t lane = i ^ flip_, run = Footprint::sample_of(lane);
    const std::uint32_t turn = packets_ < kPoints ? run * packets_ / kPoints : run;
    const std::uint32_t place = (next_ + turn) % packets_;
    const sampling::SobolPoint s =
        sampling::sequence_point(first_ * kPoints + run * packets_ + place, all_.low_discrepancy_);
    x_[lane] = s.x, y_[lane] = s.y;
    const bool late = packets_ > 1 && place >= packets_ / 2;
    const std::uint32_t bits = packets_ > 1 ? 6 : 8;
    second_ |= std::uint32_t((std::popcount(run & bits) % 2 != 0) != late) << i;
  }
}

void PolygonLight::Shadow::near_rays(simd::LightRays& to) const {
  const float unit = luminance(light_.radiance);
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const math::Vec2 u = sampling::scrambled({x_[i ^ flip_], y_[i ^ flip_]}, seed_);
    const light::LightSample s = all_.world_.lights.sampler_from(at_.position[i], light_).sample(u);
    const math::Vec3 d = s.shadow_ray(at_.origin[i]).direction;
    to.direction[0][i] = d.x, to.direction[1][i] = d.y, to.direction[2][i] = d.z;
    const bool above = dot(at_.geometric_normal[i], s.direction) > 0;
    const float cosine = std::max(0.f, dot(at_.shading_normal[i], s.direction));
    to.weight[i] = above && unit > 0 ? luminance(s.value) * cosine / unit : 0.f;
  }
}

void PolygonLight::Shadow::add(const trace::RayPacket& rays, const simd::LightRays& to,
                               std::uint32_t blocked) {
  for (std::uint32_t i = 0; i < kPoints; ++i) {
    const float weight = rays.active >> i & 1 ? to.weight[i] : 0.f;
    Sums& half = half_[second_ >> i & 1];
    half.sent += weight;
    half.arrived += blocked >> i & 1 ? 0.f : weight;
    half.rays += 1;
  }
  lit_ = lit_ || (rays.active & ~blocked) != 0;
  blocked_ = blocked_ || (rays.active & blocked) != 0;
}

float PolygonLight::Shadow::irradiance(const Sums& s) const {
  if (!view_.exact) return s.arrived / s.rays;
  return s.sent > 0 ? view_.mean * (s.arrived / s.sent) : 0;
}

PolygonLight::Arrived PolygonLight::Shadow::arrived() const {
  const Sums &a = half_[0], &b = half_[1];
  const Sums all{a.sent + b.sent, a.arrived + b.arrived, a.rays + b.rays};
  const float net = all_.low_discrepancy_ ? sampling::kPolygonNetCorrection : 1;
  return {irradiance(all), net * (irradiance(a) - irradiance(b)) / 2};
}

}  // namespace kiln::solver::direct
