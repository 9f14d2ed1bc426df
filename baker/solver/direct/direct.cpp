#include "baker/solver/direct/direct.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "baker/sampling/sobol.h"
#include "baker/solver/direct/polygon_light.h"

namespace kiln::solver::direct {
namespace {

/// Texels that choose among lights alike.
constexpr std::uint32_t kLightTileTexels = 16;
constexpr std::uint32_t kPilots = 4;
/// Lights nearer than so many radii of the footprint are weighed at four of its points.
constexpr float kNearRadii = 4;

/// Shadow rays that wait for a full packet, each with what it brings if nothing is in its way.
class ShadowBatch {
 public:
  explicit ShadowBatch(const World& world)
      : rays_(world.rays),
        correction_(
            world.settings.uses(proto::Technique::kLowDiscrepancy) ? sampling::kNetCorrection : 1) {
  }

  void add(math::Vec3 origin, const light::ShadowRay& ray, math::Rgb value, bool second_half) {
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
  sampling::Estimate take_estimate() {
    flush();
    sampling::Estimate e = std::exchange(sum_, sampling::HalfSums{}).estimate();
    e.half_difference *= correction_;
    return e;
  }
  std::uint64_t traced() const { return traced_; }

 private:
  const trace::RayScene& rays_;
  const float correction_;  ///< factor: of a net or of independent samples
  trace::RayPacket packet_;
  std::uint32_t waiting_ = 0;
  bool second_[16];
  math::Rgb value_[16];
  sampling::HalfSums sum_;
  std::uint64_t traced_ = 0;
};

/// Returns the cosine at the receiver; 0 below either horizon.
float receiver_cosine(const Footprint& at, std::uint32_t point, math::Vec3 direction) {
  if (dot(at.geometric_normal[point], direction) <= 0) return 0;
  return std::max(0.f, dot(at.shading_normal[point], direction));
}

/// Returns the light of punctual lights, from every point of the footprint. It has no part in the
/// half difference: the points are the same whatever the number of samples, and two halves of them
/// differ by far more than all of them do from the footprint.
math::Rgb punctual_light(const World& world, const Footprint& at, ShadowBatch& shadows) {
  constexpr float kShare = 1.f / Footprint::kPoints;
  for (const scene::PunctualLight& light : world.lights.punctual())
    for (std::uint32_t i = 0; i < Footprint::kPoints; ++i) {
      const light::PunctualSample a = light::sample_punctual(light, at.position[i]);
      const float cosine = receiver_cosine(at, i, a.direction);
      const math::Rgb value = a.irradiance * (cosine * kShare);
      if (!is_black(value)) shadows.add(at.origin[i], a.shadow_ray(at.origin[i]), value, false);
    }
  return shadows.take_estimate().mean;
}

/// Picks lights by rising positions in [0, 1) from shares that sum to 1, as LightChoice::Walk does.
class ShareWalk {
 public:
  explicit ShareWalk(std::span<const float> share) : share_(share) {}

  light::LightChoice::Pick at(double position) {
    while (light_ + 1 < share_.size() && position >= below_ + double(share_[light_]))
      below_ += double(share_[light_++]);
    return {light_, share_[light_]};
  }

 private:
  std::span<const float> share_;
  std::uint32_t light_ = 0;
  double below_ = 0;  // summed shares of the lights before light_
};

/// Gives the point of the footprint from which each of `count` samples is taken, and the point of
/// the texel's sequence by which it is taken, of which `first` were used before.
class SampleOrder {
 public:
  SampleOrder(const World& world, std::uint32_t first, std::uint32_t count, std::uint32_t seed)
      : low_discrepancy_(world.settings.uses(proto::Technique::kLowDiscrepancy)),
        first_(first),
        second_half_((count + 1) / 2),
        seed_(seed),
        point_flip_(sampling::hash(seed, 2)) {}

  /// Runs of four and strides of four both spread over the footprint: neither the part of a light
  /// nor the stratum of the net that a run makes goes with one point alone.
  std::uint32_t footprint_point(std::uint32_t k) const {
    return (k >> 2 ^ k ^ point_flip_) % Footprint::kPoints;
  }
  /// Every second sample is a systematic sample by itself; so are both halves of the sequence.
  math::Vec2 sample(std::uint32_t k) const {
    const std::uint32_t index = first_ + (k & 1 ? second_half_ : 0) + k / 2;
    return scrambled(sampling::sequence_point(index, low_discrepancy_), seed_);
  }

 private:
  bool low_discrepancy_;
  std::uint32_t first_, second_half_, seed_, point_flip_;
};

/// Returns the light of the area lights by `count` samples, whose lights `walk` picks
/// systematically. Unbiased. `first` samples were drawn before.
template <class Walk>
sampling::Estimate sampled_light(const World& world, const Footprint& at, Walk walk,
                                 std::uint32_t first, std::uint32_t count, std::uint32_t seed,
                                 ShadowBatch& shadows) {
  const float start = sampling::to_unit(sampling::hash(seed, 1, first));
  const SampleOrder order(world, first, count, seed);
  // The light that was picked last, as the points see it.
  std::array<std::optional<light::AreaLightSampler>, Footprint::kPoints> seen;
  std::uint32_t seen_light = ~0u;
  for (std::uint32_t k = 0; k < count; ++k) {
    const light::LightChoice::Pick pick = walk.at((double(k) + double(start)) / double(count));
    if (!(pick.probability > 0)) continue;
    const std::uint32_t i = order.footprint_point(k);
    if (pick.light != seen_light)
      for (auto& from_point : seen) from_point.reset();
    seen_light = pick.light;
    if (!seen[i])
      seen[i].emplace(world.lights.sampler_from(at.position[i], world.lights.area()[pick.light]));
    const light::LightSample s = seen[i]->sample(order.sample(k));
    const float cosine = receiver_cosine(at, i, s.direction);
    const math::Rgb value = s.value * (cosine / (float(count) * pick.probability));
    if (!is_black(value)) shadows.add(at.origin[i], s.shadow_ray(at.origin[i]), value, k & 1);
  }
  return shadows.take_estimate();
}

/// A texel that is lit.
struct Receiver {
  std::uint32_t texel = 0, seed = 0;
  Footprint at;
};

/// Returns the light of the bright parts of the sky by `count` samples; the hemisphere's rays find
/// the rest of it (see SkyShares). `first` samples were drawn before.
sampling::Estimate bright_sky(const World& world, const Footprint& at, std::uint32_t first,
                              std::uint32_t count, std::uint32_t seed, ShadowBatch& shadows) {
  const light::SkyShares shares = sky_shares(world.plan);
  const SampleOrder order(world, first, count, seed);
  for (std::uint32_t k = 0; k < count; ++k) {
    const std::uint32_t i = order.footprint_point(k);
    const light::SkyLight::Sample s = world.lights.sky()->sample(order.sample(k));
    const float cosine = receiver_cosine(at, i, s.direction);
    const float weight = shares.of_bright(s.seen.density, cosine);
    const math::Rgb value = s.seen.radiance * (cosine * weight / float(count));
    if (!is_black(value))
      shadows.add(at.origin[i], light::ShadowRay::endless(s.direction), value, k & 1);
  }
  return shadows.take_estimate();
}

/// When there are many lights, the texels of a tile choose among them alike.
class ManyLights {
 public:
  explicit ManyLights(const World& world)
      : world_(world), polygon_(world), choice_(world.lights.table()) {}

  void light(std::span<const Receiver> tile, std::uint32_t first, std::uint32_t count,
             ShadowBatch& shadows, std::span<sampling::Estimate> arrived) {
    start_tile(tile);
    for (std::size_t i = 0; i < tile.size(); ++i)
      arrived[i] += sampled_light(world_, tile[i].at, light::LightChoice::Walk(choice_), first,
                                  count, tile[i].seed, shadows);
  }
  static std::uint64_t traced() { return 0; }  ///< beside the batch's

 private:
  /// Looks at the lights from up to four texels spread over the tile, and from one of each surface
  /// in it. Each stands for those that are nearest to it: what only one of them sees must not be
  /// left to chance.
  void start_tile(std::span<const Receiver> tile) {
    choice_.clear();
    if (!world_.settings.uses(proto::Technique::kLightImportance)) return choice_.finish();
    const atlas::TextureGroup& texels = world_.texels;
    const std::size_t step = std::max(std::size_t(1), tile.size() / kPilots);
    pilots_.clear();
    for (std::size_t i = 0; i < tile.size(); ++i) {
      const std::uint32_t t = tile[i].texel;
      const bool new_surface =
          i > 0 && (texels.chart[t] != texels.chart[t - 1] ||
                    dot(texels.shading_normal[t], texels.shading_normal[t - 1]) < 0.9f);
      if (i % step == 0 || new_surface) pilots_.push_back(i);
    }
    // A texel of another surface counts as farther away.
    const auto distance = [&](std::size_t i, std::size_t k) {
      const std::uint32_t t = tile[i].texel, u = tile[k].texel;
      const math::Vec3 d = texels.position[t] - texels.position[u];
      const bool other = texels.chart[t] != texels.chart[u] ||
                         dot(texels.shading_normal[t], texels.shading_normal[u]) < 0.9f;
      return std::tuple(i != k, other, dot(d, d));
    };
    for (auto& group : around_) group.clear();
    for (std::size_t i = 0; i < tile.size(); ++i) {
      const auto nearest = std::min_element(
          pilots_.begin(), pilots_.end(),
          [&](std::size_t a, std::size_t b) { return distance(i, a) < distance(i, b); });
      around_[*nearest].push_back(i);
    }
    for (const std::size_t pilot : pilots_) look_from(tile, pilot);
    choice_.finish();
  }

  /// Lights far away are weighed at one point, nearer ones at four of the pilot's footprint, whose
  /// middle tells little then.
  void look_from(std::span<const Receiver> tile, std::size_t pilot) {
    const Footprint& at = tile[pilot].at;
    const simd::PointFrames frames = at.frames();
    const std::uint32_t texel = tile[pilot].texel;
    const math::Vec3 p = world_.texels.position[texel], n = world_.texels.shading_normal[texel];
    const auto farthest = [p](const Footprint& footprint) {
      float square = 0;
      for (const math::Vec3& q : footprint.position) square = std::max(square, dot(q - p, q - p));
      return std::sqrt(square);
    };
    float extent = 0;
    for (const std::size_t i : around_[pilot]) extent = std::max(extent, farthest(tile[i].at));
    const simd::Viewpoint from{{p.x, p.y, p.z}, {n.x, n.y, n.z}, extent, kNearRadii * farthest(at)};
    choice_.add(from, [&](std::uint32_t l) {
      const light::AreaLight& light = world_.lights.area()[l];
      return luminance(light.radiance) * polygon_.view(light, at, frames, 4).mean;
    });
  }

  const World& world_;
  const PolygonLight polygon_;
  light::LightChoice choice_;
  std::vector<std::size_t> pilots_;                                ///< places in the tile
  std::array<std::vector<std::size_t>, kLightTileTexels> around_;  ///< what each pilot stands for
};

/// When there are few lights, those that earn whole packets of the samples are lamps with a closed
/// form each; the others share what is left.
class FewLights {
 public:
  explicit FewLights(const World& world) : world_(world), polygon_(world) {
    for (auto& views : views_) views.resize(world.lights.area().size());
    for (auto& share : share_) share.resize(world.lights.area().size());
  }

  void light(std::span<const Receiver> tile, std::uint32_t first, std::uint32_t count,
             ShadowBatch& shadows, std::span<sampling::Estimate> arrived) {
    const auto& lights = world_.lights.area();
    for (std::size_t i = 0; i < tile.size(); ++i) {
      frames_[i] = tile[i].at.frames();
      weigh(tile[i], i);
    }
    const bool closed_form = world_.settings.uses(proto::Technique::kClosedForm);
    for (std::uint32_t l = 0; l < lights.size(); ++l)
      if (closed_form && lights[l].is_uniform()) light_by(l, tile, first, count, arrived);
    for (std::size_t i = 0; i < tile.size(); ++i)
      light_by_rest(tile[i], share_[i], first, count, shadows, arrived[i]);
  }
  std::uint64_t traced() const { return traced_; }

 private:
  /// A light must earn this many packets of samples to be a lamp.
  static constexpr float kLampPackets = 0.75f;
  /// This many of its packets are sent at first.
  static constexpr std::uint32_t kProbeShare = 4;

  /// Returns the share of every light in what the receiver would get if nothing stood between.
  void weigh(const Receiver& to, std::size_t i) {
    const auto& lights = world_.lights.area();
    float total = 0;
    for (std::size_t l = 0; l < lights.size(); ++l) {
      views_[i][l] = polygon_.view(lights[l], to.at, frames_[i]);
      total += share_[i][l] = luminance(lights[l].radiance) * views_[i][l].mean;
    }
    for (float& share : share_[i]) share = total > 0 ? share / total : 0;
  }

  /// When the first rays from all texels of the tile agree, all of them lit or all in the dark, no
  /// more are sent: a half-shadow that small holds little light, and the more rays are asked for,
  /// the more there are to find it. A lamp's packets are a run of its own sequence: those between
  /// its shares of the samples before and after. So rounds neither repeat nor leave out any.
  void light_by(std::uint32_t l, std::span<const Receiver> tile, std::uint32_t first,
                std::uint32_t count, std::span<sampling::Estimate> arrived) {
    const light::AreaLight& light = world_.lights.area()[l];
    std::vector<PolygonLight::Shadow>& shadows = shadows_;
    std::array<std::size_t, kLightTileTexels> of{};
    shadows.clear();
    bool lit = false, blocked = false;
    for (std::size_t i = 0; i < tile.size(); ++i) {
      float& share = share_[i][l];
      if (!(share * float(count) / Footprint::kPoints >= kLampPackets)) continue;
      const auto packets = [&](std::uint32_t samples) {
        return std::uint32_t(std::floor(float(samples) / Footprint::kPoints * share + 0.5f));
      };
      const std::uint32_t begin = packets(first), end = std::max(packets(first + count), begin + 1);
      of[shadows.size()] = i;
      PolygonLight::Shadow& s =
          shadows.emplace_back(polygon_, light, views_[i][l], tile[i].at, frames_[i], begin,
                               end - begin, sampling::hash(tile[i].seed, l));
      traced_ +=
          s.send_until(probes_ ? (s.packets() + kProbeShare - 1) / kProbeShare : s.packets());
      lit = lit || s.lit(), blocked = blocked || s.blocked();
      share = 0;
    }
    for (std::size_t k = 0; k < shadows.size(); ++k) {
      if (lit && blocked) traced_ += shadows[k].send_until(shadows[k].packets());
      const PolygonLight::Arrived a = shadows[k].arrived();
      arrived[of[k]] += sampling::Estimate{light.radiance * a.irradiance,
                                           luminance(light.radiance) * a.half_difference};
    }
  }

  /// Adds the light of those that were no lamps to the receiver.
  void light_by_rest(const Receiver& to, std::span<float> share, std::uint32_t first,
                     std::uint32_t count, ShadowBatch& shadows, sampling::Estimate& arrived) {
    const float rest = std::accumulate(share.begin(), share.end(), 0.f);
    if (!(rest > 0)) return;
    for (float& s : share) s /= rest;
    const auto part = [&](std::uint32_t n) { return std::uint32_t(std::ceil(float(n) * rest)); };
    arrived +=
        sampled_light(world_, to.at, ShareWalk(share), part(first), part(count), to.seed, shadows);
  }

  const World& world_;
  const PolygonLight polygon_;
  const bool probes_ = world_.settings.uses(proto::Technique::kShadowProbes);
  std::array<simd::PointFrames, kLightTileTexels> frames_;
  std::array<std::vector<PolygonLight::View>, kLightTileTexels> views_;
  std::array<std::vector<float>, kLightTileTexels> share_;
  std::vector<PolygonLight::Shadow> shadows_;
  std::uint64_t traced_ = 0;
};

/// @param area_lights FewLights or ManyLights
template <class AreaLights>
std::uint64_t light_texels(const World& world, AreaLights area_lights, atlas::TexelRange range,
                           std::uint32_t first, std::uint32_t count, const DirectLight::Put& put) {
  ShadowBatch shadows(world);
  std::vector<Receiver> tile;
  std::array<sampling::Estimate, kLightTileTexels> arrived;
  for (std::uint32_t begin = range.begin; begin < range.end; begin += kLightTileTexels) {
    tile.clear();
    for (std::uint32_t t = begin; t < std::min(begin + kLightTileTexels, range.end); ++t) {
      tile.push_back({t, texel_seed(world, t, SampleStream::kDirect), Footprint(world, t)});
      arrived[t - begin] = sampling::Estimate{punctual_light(world, tile.back().at, shadows)};
    }
    if (!world.lights.area().empty()) area_lights.light(tile, first, count, shadows, arrived);
    for (const Receiver& r : tile) {
      sampling::Estimate& e = arrived[r.texel - begin];
      if (world.lights.has_bright_sky())
        e += bright_sky(world, r.at, first, count, sampling::hash(r.seed, kSkyDraws), shadows);
      put(r.texel, e);
    }
  }
  return shadows.traced() + area_lights.traced();
}

}  // namespace

std::uint64_t DirectLight::run(atlas::TexelRange range, std::uint32_t first, std::uint32_t count,
                               const Put& put) const {
  return are_many(world_.lights)
             ? light_texels(world_, ManyLights(world_), range, first, count, put)
             : light_texels(world_, FewLights(world_), range, first, count, put);
}

}  // namespace kiln::solver::direct
