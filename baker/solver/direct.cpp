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

/// Picks lights by rising positions in [0, 1) from shares that sum to 1, as LightChoice::Walk does.
class ShareWalk {
 public:
  explicit ShareWalk(std::span<const float> share) : share_(share) {}

  LightChoice::Pick at(double position) {
    while (light_ + 1 < share_.size() && position >= below_ + double(share_[light_]))
      below_ += double(share_[light_++]);
    return {light_, share_[light_]};
  }

 private:
  std::span<const float> share_;
  std::uint32_t light_ = 0;
  double below_ = 0;  // summed shares of the lights before light_
};

/// Light from the area lights by `count` samples, whose lights `walk` picks systematically.
/// Unbiased. `first` samples were drawn before.
template <class Walk>
Halves sampled_light(const SolverInput& in, const Footprint& at, Walk walk, std::uint32_t first,
                     std::uint32_t count, std::uint32_t seed, ShadowBatch& shadows) {
  const float start = to_unit(hash(seed, 1, first));
  const std::uint32_t point_flip = hash(seed, 2);
  for (std::uint32_t k = 0; k < count; ++k) {
    const LightChoice::Pick pick = walk.at((double(k) + double(start)) / double(count));
    if (!(pick.probability > 0)) continue;
    // Runs of four and strides of four both spread over the footprint: neither the part of a light
    // nor the stratum of the net that a run makes goes with one point alone.
    const std::uint32_t i = (k >> 2 ^ k ^ point_flip) % Footprint::kPoints;
    // Every second draw is a systematic sample by itself; so are both halves of the sequence.
    const std::uint32_t point = first + (k & 1 ? (count + 1) / 2 : 0) + k / 2;
    const LightSample s = in.lights.sample(in.lights.area()[pick.light], at.position[i],
                                           scrambled(sobol(point), seed));
    const float cosine = receiver_cosine(at, i, s.direction);
    const Rgb value = s.value * (cosine / (float(count) * pick.probability));
    if (!is_black(value)) shadows.add(at.origin[i], s.shadow_ray(at.origin[i]), value, k & 1);
  }
  return shadows.take_sum();
}

/// Many lights: the texels of a tile choose among them alike.
class ManyLights {
 public:
  explicit ManyLights(const SolverInput& in) : in_(in), lamp_(in), choice_(in.lights.table()) {}

  /// Looks at the lights from up to four texels spread over the tile, and from one of each surface
  /// in it.
  void start_tile(TexelRange tile) {
    choice_.clear();
    const TextureGroup& texels = in_.texels;
    const std::uint32_t step = std::max(1u, tile.size() / kPilots);
    for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
      const bool new_surface =
          t > tile.begin && (texels.chart[t] != texels.chart[t - 1] ||
                             dot(texels.shading_normal[t], texels.shading_normal[t - 1]) < 0.9f);
      if ((t - tile.begin) % step == 0 || new_surface) look_from(t);
    }
    choice_.finish();
  }
  LightChoice::Walk walk() const { return LightChoice::Walk(choice_); }

 private:
  /// At one point towards lights that are far away against the footprint, else at all of its
  /// points, for its middle tells little then.
  void look_from(std::uint32_t texel) {
    const Footprint at(in_, texel);
    const PointFrames frames = at.frames();
    const Vec3 p = in_.texels.position[texel];
    float radius2 = 0;
    for (const Vec3& q : at.position) radius2 = std::max(radius2, dot(q - p, q - p));
    choice_.add(p, in_.texels.shading_normal[texel], kNearRadii * std::sqrt(radius2),
                [&](std::uint32_t l) {
                  const AreaLight& light = in_.lights.area()[l];
                  return luminance(light.radiance) * lamp_.view(light, at, frames).mean;
                });
  }

  const SolverInput& in_;
  const LampLight lamp_;
  LightChoice choice_;
};

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
    to.add(sampled_light(in_, at, ShareWalk(share_), part(first), part(count), seed, shadows));
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
  ManyLights many_lights(in_);
  ShadowBatch shadows(in_.rays);
  for (std::uint32_t t = range.begin; t < range.end; ++t) {
    if (light_count > 0 && !few && t % kTileTexels == 0)
      many_lights.start_tile({t, std::min(t + kTileTexels, in_.texels.size())});
    const Footprint at(in_, t);
    const std::uint32_t seed = texel_seed(in_, t, Purpose::kDirect);
    Arrived arrived;
    arrived.irradiance = punctual_light(in_, at, shadows);
    if (light_count > 0 && few)
      few_lights.run(at, first, count, seed, shadows, arrived);
    else if (light_count > 0)
      arrived.add(sampled_light(in_, at, many_lights.walk(), first, count, seed, shadows));
    irradiance[t] = arrived.irradiance;
    spread[t] = arrived.spread;
  }
  return shadows.traced() + few_lights.traced();
}

}  // namespace kiln::baker
