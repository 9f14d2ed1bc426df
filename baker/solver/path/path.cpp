#include "baker/solver/path/path.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "baker/sampling/estimate.h"
#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"
#include "baker/solver/emittance.h"
#include "baker/solver/footprint.h"

namespace kiln::solver::path {
namespace {

/// Samples of one pass; a pass over a batch of texels then takes some tens of milliseconds.
constexpr std::uint32_t kBlockSamples = 16;

/// Pairs of random numbers that one path vertex uses.
enum Dimension : std::uint32_t { kDirection, kAreaPoint, kChoice, kDimensions };

/// A vertex of a path that is still on its way.
struct Vertex {
  math::Vec3 origin, position, geometric_normal, shading_normal;
  math::Rgb throughput{1, 1, 1};  ///< product of the albedos so far
  std::uint32_t sample = 0;

  /// The last eight of each sixteen samples make the second half.
  bool in_second_half() const { return (sample & 8) != 0; }
};

/// Each vertex draws one direction in either way.
const light::SkyShares kShares{1, 1};

struct Sums {
  sampling::HalfSums direct, sky, indirect;
};

/// Follows sixteen paths of one texel in step.
class PathBundle {
 public:
  PathBundle(const World& world, std::uint32_t texel)
      : world_(world), at_(world, texel), seed_(texel_seed(world, texel, SampleStream::kPath)) {}

  /// Adds the samples [first, first + count), at most 16.
  void follow(std::uint32_t first, std::uint32_t count, Sums& sums) {
    start(first, count);
    for (std::uint32_t bounce = 0; !alive_.empty(); ++bounce) {
      sampling::HalfSums& from_lights = bounce == 0 ? sums.direct : sums.indirect;
      add_area_light(bounce, from_lights);
      add_punctual_light(bounce, from_lights);
      add_bright_sky(bounce, from_lights);
      extend(bounce, bounce == 0 ? sums.sky : sums.indirect, sums.indirect);
    }
  }
  std::uint64_t traced() const { return traced_; }
  std::uint64_t behind() const { return behind_; }

 private:
  math::Vec2 random(const Vertex& v, std::uint32_t bounce, Dimension d) const {
    return sampling::sample_pair(v.sample, sampling::hash(seed_, bounce * kDimensions + d));
  }

  void start(std::uint32_t first, std::uint32_t count) {
    alive_.clear();
    const std::uint32_t flip = sampling::hash(seed_, first, 0x51u);
    for (std::uint32_t k = 0; k < count; ++k) {
      const std::uint32_t i = (k ^ flip) % Footprint::kPoints;
      Vertex v;
      v.origin = at_.origin[i], v.position = at_.position[i];
      v.geometric_normal = at_.geometric_normal[i], v.shading_normal = at_.shading_normal[i];
      v.sample = first + k;
      alive_.push_back(v);
    }
  }

  /// Traces the collected shadow rays and adds what arrives.
  void trace_shadows(sampling::HalfSums& sum) {
    if (waiting_ == 0) return;
    packet_.activate_first(waiting_);
    const std::uint32_t blocked = world_.rays.occluded(packet_);
    for (std::uint32_t i = 0; i < waiting_; ++i)
      if (!(blocked >> i & 1)) sum.half[second_[i]] += value_[i];
    traced_ += waiting_;
    waiting_ = 0;
  }

  /// @param to_light   unit
  /// @param irradiance at normal incidence, where nothing is in the ray's way
  void add_shadow_ray(const Vertex& v, math::Vec3 to_light, const light::ShadowRay& ray,
                      math::Rgb irradiance) {
    if (dot(v.geometric_normal, to_light) <= 0) return;
    const float cosine = std::max(0.f, dot(v.shading_normal, to_light));
    const math::Rgb value = v.throughput * irradiance * cosine;
    if (is_black(value)) return;
    value_[waiting_] = value;
    second_[waiting_] = v.in_second_half();
    packet_.set(waiting_++, v.origin, ray.direction, ray.far);
  }

  void add_area_light(std::uint32_t bounce, sampling::HalfSums& sum) {
    const auto& lights = world_.lights.area();
    if (lights.empty()) return;
    const auto& share = world_.lights.power_share();
    for (const Vertex& v : alive_) {
      float u = random(v, bounce, kChoice).x;
      std::size_t l = 0;
      while (l + 1 < lights.size() && u >= share[l]) u -= share[l++];
      if (!(share[l] > 0)) continue;
      const light::LightSample s =
          world_.lights.sampler_from(v.position, lights[l]).sample(random(v, bounce, kAreaPoint));
      add_shadow_ray(v, s.direction, s.shadow_ray(v.origin), s.value * (1 / share[l]));
    }
    trace_shadows(sum);
  }

  void add_punctual_light(std::uint32_t bounce, sampling::HalfSums& sum) {
    const auto& lights = world_.lights.punctual();
    if (lights.empty()) return;
    for (const Vertex& v : alive_) {
      const float u = random(v, bounce, kChoice).y;
      const auto l = std::min(lights.size() - 1, std::size_t(u * float(lights.size())));
      const light::PunctualSample a = light::sample_punctual(lights[l], v.position);
      add_shadow_ray(v, a.direction, a.shadow_ray(v.origin), a.irradiance * float(lights.size()));
    }
    trace_shadows(sum);
  }

  /// The bright parts of a sky map; extend() counts what this leaves of it.
  void add_bright_sky(std::uint32_t bounce, sampling::HalfSums& sum) {
    if (!world_.lights.has_bright_sky()) return;
    const std::uint32_t seed = sampling::hash(seed_, kSkyDraws, bounce);
    for (const Vertex& v : alive_) {
      const light::SkyLight::Sample s =
          world_.lights.sky()->sample(sampling::sample_pair(v.sample, seed));
      const float cosine = dot(v.shading_normal, s.direction);
      if (cosine <= 0) continue;
      add_shadow_ray(v, s.direction, light::ShadowRay::endless(s.direction),
                     s.seen.radiance * kShares.of_bright(s.seen.density, cosine));
    }
    trace_shadows(sum);
  }

  /// Returns what a ray that left the vertex meets of the sky.
  math::Rgb sky_seen(const Vertex& v, math::Vec3 direction) const {
    if (!world_.lights.sky()) return world_.scene.sky;
    const light::SkyLight::Seen seen = world_.lights.sky()->seen(direction);
    const float cosine = std::max(0.f, dot(v.shading_normal, direction));
    return seen.radiance * kShares.of_cosine(seen.density, cosine);
  }

  /// Returns the radiance of an emitter that a ray met, on the side that shines.
  math::Rgb emission_met(const trace::HitPacket& met, std::uint32_t i) const {
    const std::uint32_t triangle = met.triangle[i];
    if (!is_emissive(world_.scene, triangle)) return {};
    if (met.back[i] && !world_.scene.material_of(triangle).double_sided) return {};
    return emission_at(world_.scene, triangle, {met.u[i], met.v[i]});
  }

  /// Sends each path on by a cosine-distributed direction; those that end are dropped.
  /// @param emitted grows by the light of emitters that are met, where no shadow rays look for it
  void extend(std::uint32_t bounce, sampling::HalfSums& sky, sampling::HalfSums& emitted) {
    std::uint32_t kept = 0;
    for (std::size_t i = 0; i < alive_.size(); ++i) {
      Vertex v = alive_[i];
      const math::Vec3 d = sampling::Frame(v.shading_normal)
                               .to_world(sampling::cosine_direction(random(v, bounce, kDirection)));
      if (dot(d, v.geometric_normal) <= 0) continue;
      packet_.set(kept, v.origin, d, std::numeric_limits<float>::infinity());
      alive_[kept++] = v;
    }
    packet_.activate_first(kept);
    alive_.resize(kept);
    if (kept == 0) return;
    trace::HitPacket met;
    world_.rays.closest(packet_, met);
    traced_ += kept;
    std::vector<Vertex>& paths = alive_;
    std::uint32_t going = 0;
    for (std::uint32_t i = 0; i < kept; ++i) {
      Vertex v = paths[i];
      if (met.triangle[i] == trace::kNoHit) {
        const math::Vec3 d{packet_.dir_x[i], packet_.dir_y[i], packet_.dir_z[i]};
        sky.half[v.in_second_half()] += v.throughput * sky_seen(v, d) * math::kPi;
        continue;
      }
      if (emitters_send(world_.settings))
        emitted.half[v.in_second_half()] += v.throughput * emission_met(met, i) * math::kPi;
      if (bounce < world_.settings.bounces && reflect(v, met, i)) {
        paths[going++] = v;
      } else if (bounce == 0 && met.back[i]) {
        behind_ += !world_.scene.material_of(met.triangle[i]).double_sided;
      }
    }
    paths.resize(going);
  }

  /// Moves the vertex to what its ray met. Returns false when the light ends there.
  bool reflect(Vertex& v, const trace::HitPacket& met, std::uint32_t i) {
    const std::uint32_t triangle = met.triangle[i];
    if (met.back[i] && !world_.scene.material_of(triangle).double_sided) return false;
    const scene::Bary bary{met.u[i], met.v[i]};
    const math::Rgb a = albedo_at(world_.scene, triangle, bary);
    v.throughput =
        v.throughput * math::Rgb{std::min(a.r, scene::kMaxAlbedo), std::min(a.g, scene::kMaxAlbedo),
                                 std::min(a.b, scene::kMaxAlbedo)};
    if (is_black(v.throughput)) return false;
    const float side = met.back[i] ? -1.f : 1.f;
    v.geometric_normal = side * geometric_normal(world_.scene, triangle);
    v.shading_normal = side * shading_normal(world_.scene, triangle, bary);
    v.position = position_at(world_.scene, triangle, bary);
    v.origin = world_.rays.offset_origin(v.position, v.geometric_normal,
                                         position_at(world_.scene, triangle, scene::kCentroid));
    return true;
  }

  const World& world_;
  const Footprint at_;
  const std::uint32_t seed_;
  std::vector<Vertex> alive_;
  trace::RayPacket packet_;
  std::uint32_t waiting_ = 0;  ///< shadow rays in the packet
  math::Rgb value_[16];
  bool second_[16];
  std::uint64_t traced_ = 0, behind_ = 0;
};

/// A block of samples of every texel; the light afterwards is the mean over all samples so far.
class PathPass final : public Pass {
 public:
  PathPass(const World& world, PassPlan plan, std::uint32_t first, std::uint32_t count)
      : Pass(std::move(plan)), world_(world), first_(first), count_(count) {
    using enum lightmap::PlaneId;
    plan_.writes = lightmap::plane_set({kDirect, kSky, kIndirect, kDirectDifference, kSkyDifference,
                                        kIndirectDifference, kValidity, kSamples});
    plan_.reads = plan_.writes;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    const float old_share = float(first_) / float(first_ + count_);
    const float scale = 1 / float(first_ + count_);
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      PathBundle bundle(world_, t);
      Sums sums;
      bundle.follow(first_, count_, sums);
      const auto join = [&](const sampling::HalfSums& more, const lightmap::Plane<math::Rgb>& mean,
                            const lightmap::Plane<float>& difference, math::Rgb& new_mean,
                            float& new_difference) {
        const sampling::Estimate e = more.estimate();
        new_mean = mean[t] * old_share + e.mean * scale;
        new_difference = difference[t] * old_share + e.half_difference * scale;
      };
      join(sums.direct, before.direct, before.direct_difference, after.direct[t],
           after.direct_difference[t]);
      join(sums.sky, before.sky, before.sky_difference, after.sky[t], after.sky_difference[t]);
      join(sums.indirect, before.indirect, before.indirect_difference, after.indirect[t],
           after.indirect_difference[t]);
      after.samples[t] = first_ + count_;
      const float open = float(count_ - bundle.behind());
      after.validity[t] = before.validity[t] * old_share + open * scale;
      rays += bundle.traced();
    }
    return rays;
  }

 private:
  const World& world_;
  const std::uint32_t first_, count_;  ///< samples
};

class PathSolver final : public Solver {
 public:
  explicit PathSolver(const World& world) : world_(world) {}

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    if (done.size() >= passes()) return nullptr;
    PassPlan plan;
    plan.name = "paths";
    plan.index = static_cast<std::uint32_t>(done.size());
    plan.completes = plan.index + 1 == passes();
    const std::uint32_t first = plan.index * kBlockSamples;
    const std::uint32_t count = std::min(kBlockSamples, world_.plan.directions - first);
    plan.work = work_of(count);
    return std::make_unique<PathPass>(world_, std::move(plan), first, count);
  }
  Forecast forecast() const override { return {passes(), work_of(world_.plan.directions)}; }
  const SamplePlan& samples() const override { return world_.plan; }

 private:
  std::uint32_t passes() const {
    return (world_.plan.directions + kBlockSamples - 1) / kBlockSamples;
  }
  /// Returns the work in shadow rays: a path has a few segments, each with as many of them.
  Work work_of(std::uint32_t paths) const {
    return Work::directions(paths * 2 * std::min(4.0, 1 + double(world_.settings.bounces)));
  }

  const World world_;
};

}  // namespace

std::unique_ptr<Solver> make_path_solver(const World& world) {
  return std::make_unique<PathSolver>(world);
}

}  // namespace kiln::solver::path
