#include "baker/solver/direct.h"

#include <vector>

#include "baker/solver/lamp_light.h"
#include "baker/solver/sobol.h"

namespace kiln::baker {
namespace {

constexpr std::uint32_t kTileTexels = 16;
/// Up to this many lights each texel weighs them for itself.
constexpr std::size_t kFewLights = 16;
constexpr std::uint32_t kPilots = 4;
/// Lights nearer than so many radii of the footprint are weighed at each of its points.
constexpr float kNearRadii = 4;
/// Share of a tile's samples that goes by power alone: no light that some point of it sees has
/// probability zero.
constexpr float kDefensiveShare = 0.02f;

/// Probabilities of the area lights for some texels.
struct LightDistribution {
  std::vector<float> probability;

  explicit LightDistribution(std::size_t lights) : probability(lights) {}

  void clear() { std::fill(probability.begin(), probability.end(), 0.f); }

  /// Adds what `texel` gets from each light: at one point for lights far away against the
  /// footprint, else at all of its points, for its middle tells little then.
  void add_pilot(const SolverInput& in, std::uint32_t texel, const Footprint& at) {
    const Vec3 p = in.texels.position[texel], n = in.texels.shading_normal[texel];
    float radius2 = 0;
    for (const Vec3& q : at.position) radius2 = std::max(radius2, dot(q - p, q - p));
    const float near = kNearRadii * std::sqrt(radius2);
    for (std::size_t l = 0; l < probability.size(); ++l) {
      const AreaLight& light = in.lights.area()[l];
      if (light.least_distance(p) > near) {
        probability[l] += in.lights.unoccluded_estimate(light, p, n);
        continue;
      }
      for (std::uint32_t i = 0; i < Footprint::kPoints; ++i)
        probability[l] +=
            (1.f / Footprint::kPoints) *
            in.lights.unoccluded_estimate(light, at.position[i], at.shading_normal[i]);
    }
  }

  void finish(const SolverInput& in) {
    double total = 0;
    for (float p : probability) total += p;
    const auto& share = in.lights.power_share();
    for (std::size_t l = 0; l < probability.size(); ++l)
      probability[l] = total > 0 ? (1 - kDefensiveShare) * float(probability[l] / total) +
                                       kDefensiveShare * share[l]
                                 : share[l];
  }
};

/// Light that arrived, in two halves of the samples, each of which is an estimate of half of it.
struct Halves {
  Rgb half[2];

  Rgb sum() const { return half[0] + half[1]; }
  Rgb spread() const { return half[0] - half[1]; }
};

/// Shadow rays that wait for a full packet, each with what it brings if nothing is in its way.
class ShadowBatch {
 public:
  explicit ShadowBatch(const RayScene& rays) : rays_(rays) {}

  void add(Vec3 origin, const ShadowRay& ray, Rgb value, bool second_half) {
    packet_.set(waiting_, origin, ray.direction, ray.far);
    second_[waiting_] = second_half;
    value_[waiting_++] = value;
    if (waiting_ == 16) flush();
  }
  void flush() {
    if (waiting_ == 0) return;
    packet_.activate_first(waiting_);
    const std::uint32_t blocked = rays_.occluded(packet_);
    for (std::uint32_t i = 0; i < waiting_; ++i)
      if (!(blocked >> i & 1)) sum_.half[second_[i]] += value_[i];
    traced_ += waiting_;
    waiting_ = 0;
  }
  Halves take_sum() {
    flush();
    return std::exchange(sum_, Halves{});
  }
  std::uint64_t traced() const { return traced_; }

 private:
  const RayScene& rays_;
  RayPacket packet_;
  std::uint32_t waiting_ = 0;
  bool second_[16];
  Rgb value_[16];
  Halves sum_;
  std::uint64_t traced_ = 0;
};

/// What a part of the direct light brings.
struct Arrived {
  Rgb irradiance, spread;

  void add(const Halves& h) { irradiance += h.sum(), spread += h.spread(); }
};

/// Cosine at the receiver; 0 below either horizon.
float receiver_cosine(const Footprint& at, std::uint32_t point, Vec3 direction) {
  if (dot(at.geometric_normal[point], direction) <= 0) return 0;
  return std::max(0.f, dot(at.shading_normal[point], direction));
}

/// From every point of the footprint. No part of its spread: the points are the same whatever the
/// number of samples, and two halves of them differ by far more than all of them from the
/// footprint.
Rgb punctual_light(const SolverInput& in, const Footprint& at, ShadowBatch& shadows) {
  constexpr float kShare = 1.f / Footprint::kPoints;
  for (const PunctualLight& light : in.lights.punctual())
    for (std::uint32_t i = 0; i < Footprint::kPoints; ++i) {
      const PunctualArrival a = arrive(light, at.position[i]);
      const float cosine = receiver_cosine(at, i, a.direction);
      const Rgb value = a.irradiance * (cosine * kShare);
      if (!is_black(value)) shadows.add(at.origin[i], a.shadow_ray(at.origin[i]), value, false);
    }
  return shadows.take_sum().sum();
}

/// Light from the area lights by `count` samples, drawn systematically from `probability`, whose
/// sum is 1. Unbiased. `first` samples were drawn before.
Halves sampled_light(const SolverInput& in, const Footprint& at, std::span<const float> probability,
                     std::uint32_t first, std::uint32_t count, std::uint32_t seed,
                     ShadowBatch& shadows) {
  const float start = to_unit(hash(seed, 1, first));
  const std::uint32_t point_flip = hash(seed, 2);
  std::size_t l = 0;
  float below = 0;  // summed probability of the lights before l
  for (std::uint32_t k = 0; k < count; ++k) {
    const float position = (float(k) + start) / float(count);
    while (l + 1 < probability.size() && position >= below + probability[l])
      below += probability[l++];
    if (!(probability[l] > 0)) continue;
    // Runs of four and strides of four both spread over the footprint: neither the part of a light
    // nor the stratum of the net that a run makes goes with one point alone.
    const std::uint32_t i = (k >> 2 ^ k ^ point_flip) % Footprint::kPoints;
    // Every second draw is a systematic sample by itself; so are both halves of the sequence.
    const std::uint32_t point = first + (k & 1 ? (count + 1) / 2 : 0) + k / 2;
    const LightSample s =
        in.lights.sample(in.lights.area()[l], at.position[i], scrambled(sobol(point), seed));
    const float cosine = receiver_cosine(at, i, s.direction);
    const Rgb value = s.value * (cosine / (float(count) * probability[l]));
    if (!is_black(value)) shadows.add(at.origin[i], s.shadow_ray(at.origin[i]), value, k & 1);
  }
  return shadows.take_sum();
}

/// Fills `lights` for the tile: up to four texels spread over it, and one of each chart in it.
void pilot_tile(const SolverInput& in, TexelRange tile, LightDistribution& lights) {
  lights.clear();
  const std::uint32_t step = std::max(1u, tile.size() / kPilots);
  for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
    const bool new_surface = t > tile.begin && (in.texels.chart[t] != in.texels.chart[t - 1] ||
                                                dot(in.texels.shading_normal[t],
                                                    in.texels.shading_normal[t - 1]) < 0.9f);
    if ((t - tile.begin) % step == 0 || new_surface) lights.add_pilot(in, t, Footprint(in, t));
  }
  lights.finish(in);
}

/// Few lights: those that earn whole packets of the samples are lamps with a closed form each; the
/// others share what is left.
class FewLights {
 public:
  explicit FewLights(const SolverInput& in)
      : in_(in), lamp_(in), views_(in.lights.area().size()), share_(views_.size()) {}

  void run(const Footprint& at, std::uint32_t first, std::uint32_t count, std::uint32_t seed,
           ShadowBatch& shadows, Arrived& to) {
    const PointFrames frames = at.frames();
    const auto& lights = in_.lights.area();
    float total = 0;
    for (std::size_t l = 0; l < lights.size(); ++l) {
      views_[l] = lamp_.view(lights[l], at, frames);
      total += share_[l] = luminance(lights[l].radiance) * views_[l].mean;
    }
    if (!(total > 0)) return;
    float rest = 0;
    for (std::size_t l = 0; l < lights.size(); ++l) {
      // The share is the same in every round, so those before took their part of the sequence.
      const float packets = float(count) / Footprint::kPoints * (share_[l] / total),
                  before = float(first) / Footprint::kPoints * (share_[l] / total);
      if (lights[l].is_uniform() && packets >= kLampPackets) {
        const LampLight::Arrived a = lamp_.arrive(
            lights[l], views_[l], at, frames, std::uint32_t(std::lround(before)),
            std::uint32_t(std::lround(packets)), hash(seed, std::uint32_t(l)), traced_);
        to.irradiance += lights[l].radiance * a.irradiance;
        to.spread += lights[l].radiance * a.spread;
        share_[l] = 0;
      }
      rest += share_[l];
    }
    if (!(rest > 0)) return;
    for (float& share : share_) share /= rest;
    const auto part = [&](std::uint32_t n) {
      return std::uint32_t(std::ceil(float(n) * (rest / total)));
    };
    to.add(sampled_light(in_, at, share_, part(first), part(count), seed, shadows));
  }
  std::uint64_t traced() const { return traced_; }

 private:
  /// Packets of samples that a light must earn to be a lamp.
  static constexpr float kLampPackets = 0.75f;

  const SolverInput& in_;
  const LampLight lamp_;
  std::vector<LampLight::View> views_;
  std::vector<float> share_;
  std::uint64_t traced_ = 0;
};

}  // namespace

std::uint64_t DirectLight::run(TexelRange range, std::uint32_t first, std::uint32_t count,
                               std::span<Rgb> irradiance, std::span<Rgb> spread) const {
  const std::size_t light_count = in_.lights.area().size();
  const bool few = light_count <= kFewLights;
  FewLights few_lights(in_);
  LightDistribution lights(light_count);
  ShadowBatch shadows(in_.rays);
  for (std::uint32_t t = range.begin; t < range.end; ++t) {
    if (light_count > 0 && !few && t % kTileTexels == 0)
      pilot_tile(in_, {t, std::min(t + kTileTexels, in_.texels.size())}, lights);
    const Footprint at(in_, t);
    const std::uint32_t seed = texel_seed(in_, t, Purpose::kDirect);
    Arrived arrived;
    arrived.irradiance = punctual_light(in_, at, shadows);
    if (light_count > 0 && few)
      few_lights.run(at, first, count, seed, shadows, arrived);
    else if (light_count > 0)
      arrived.add(sampled_light(in_, at, lights.probability, first, count, seed, shadows));
    irradiance[t] = arrived.irradiance;
    spread[t] = arrived.spread;
  }
  return shadows.traced() + few_lights.traced();
}

}  // namespace kiln::baker
