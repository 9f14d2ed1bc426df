#include "baker/solver/radiosity_map/emitter_light.h"

#include <algorithm>
#include <bit>

#include "baker/sampling/sobol.h"
#include "baker/solver/footprint.h"

namespace kiln::solver::radiosity_map {
namespace {

/// Pairs of random numbers of one sample.
enum Dimension : std::uint32_t { kChoice, kAreaPoint, kSkyDirection };

/// Returns whether a sample is of the second half. Any run of samples from an even one on is
/// balanced, and so is each point of the footprint over 32 samples.
bool in_second_half(std::uint32_t sample) {
  return (std::popcount(sample & 31) & 1) != 0;
}

}  // namespace

/// Takes the samples of one texel. Their shadow rays wait for full packets.
class EmitterLight::Sampler {
 public:
  Sampler(const EmitterLight& all, std::uint32_t texel)
      : world_(all.world_),
        shares_(all.shares_),
        at_(world_, texel),
        seed_(texel_seed(world_, texel, SampleStream::kIterations)) {}

  sampling::HalfSums take(Run run) {
    for (std::uint32_t k = run.first; k < run.end(); ++k) {
      const std::uint32_t flip = sampling::hash(seed_, k / Footprint::kPoints, 0x51u);
      const std::uint32_t point = (k ^ flip) % Footprint::kPoints;
      add_area_light(k, point);
      add_punctual_light(k, point);
      add_bright_sky(k, point);
    }
    flush();
    return sums_;
  }
  std::uint64_t traced() const { return traced_; }

 private:
  math::Vec2 independent(std::uint32_t sample, Dimension d) const {
    const std::uint32_t key = sampling::hash(seed_, sample, d);
    return {sampling::to_unit(key), sampling::to_unit(sampling::hash(key))};
  }
  math::Vec2 stratified(std::uint32_t sample, Dimension d) const {
    return sampling::sample_pair(sample, sampling::hash(seed_, d));
  }
  bool stratifies() const {
    return world_.settings.light_sampling == proto::LightSampling::kStratified;
  }

  void add_area_light(std::uint32_t k, std::uint32_t point) {
    const auto& lights = world_.lights.area();
    if (lights.empty()) return;
    const auto& share = world_.lights.power_share();
    float u = stratifies() ? stratified(k, kChoice).x : independent(k, kChoice).x;
    std::size_t l = 0;
    while (l + 1 < lights.size() && u >= share[l]) u -= share[l++];
    if (!(share[l] > 0)) return;
    const light::Spread spread = world_.settings.light_sampling == proto::LightSampling::kSolidAngle
                                     ? light::Spread::kSolidAngle
                                     : light::Spread::kArea;
    const light::LightSample s =
        world_.lights.sampler_from(at_.position[point], lights[l], spread)
            .sample(stratifies() ? stratified(k, kAreaPoint) : independent(k, kAreaPoint));
    add(k, point, s.direction, s.shadow_ray(at_.origin[point]), s.value * (1 / share[l]));
  }

  /// The light is drawn evenly over the samples in every mode: the thesis has no such lights.
  void add_punctual_light(std::uint32_t k, std::uint32_t point) {
    const auto& lights = world_.lights.punctual();
    if (lights.empty()) return;
    const float u = stratified(k, kChoice).y;
    const auto l = std::min(lights.size() - 1, std::size_t(u * float(lights.size())));
    const light::PunctualSample a = light::sample_punctual(lights[l], at_.position[point]);
    add(k, point, a.direction, a.shadow_ray(at_.origin[point]),
        a.irradiance * float(lights.size()));
  }

  /// The bright parts of a sky map; the directions that are followed bring the rest of it.
  void add_bright_sky(std::uint32_t k, std::uint32_t point) {
    if (!world_.lights.has_bright_sky()) return;
    const light::SkyLight::Sample s = world_.lights.sky()->sample(stratified(k, kSkyDirection));
    const float cosine = dot(at_.shading_normal[point], s.direction);
    if (cosine <= 0) return;
    add(k, point, s.direction, light::ShadowRay::endless(s.direction),
        s.seen.radiance * shares_.of_bright(s.seen.density, cosine));
  }

  /// @param to_light   unit
  /// @param irradiance at normal incidence, where nothing is in the ray's way
  void add(std::uint32_t k, std::uint32_t point, math::Vec3 to_light, const light::ShadowRay& ray,
           math::Rgb irradiance) {
    if (dot(at_.geometric_normal[point], to_light) <= 0) return;
    const math::Rgb value = irradiance * std::max(0.f, dot(at_.shading_normal[point], to_light));
    if (is_black(value)) return;
    value_[waiting_] = value;
    second_[waiting_] = in_second_half(k);
    packet_.set(waiting_++, at_.origin[point], ray.direction, ray.far);
    if (waiting_ == 16) flush();
  }
  void flush() {
    if (waiting_ == 0) return;
    packet_.activate_first(waiting_);
    const std::uint32_t blocked = world_.rays.occluded(packet_);
    for (std::uint32_t i = 0; i < waiting_; ++i)
      if (!(blocked >> i & 1)) sums_.half[second_[i]] += value_[i];
    traced_ += waiting_;
    waiting_ = 0;
  }

  const World& world_;
  const light::SkyShares& shares_;
  const Footprint at_;
  const std::uint32_t seed_;
  trace::RayPacket packet_;
  std::uint32_t waiting_ = 0;
  math::Rgb value_[16];
  bool second_[16];
  sampling::HalfSums sums_;
  std::uint64_t traced_ = 0;
};

EmitterLight::EmitterLight(const World& world) : world_(world), shares_(sky_shares(world.plan)) {}

sampling::Estimate EmitterLight::arriving(std::uint32_t texel, Run run, std::uint64_t& rays) const {
  Sampler sampler(*this, texel);
  sampling::Estimate e = sampler.take(run).estimate();
  rays += sampler.traced();
  const float scale = 1 / float(run.count);
  return {e.mean * scale, e.half_difference * scale};
}

double EmitterLight::rays_per_sample() const {
  return double(!world_.lights.area().empty()) + double(!world_.lights.punctual().empty()) +
         double(world_.lights.has_bright_sky());
}

}  // namespace kiln::solver::radiosity_map
