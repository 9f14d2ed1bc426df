#include "baker/solver/gather/hemisphere.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <limits>

#include "baker/sampling/sobol.h"
#include "baker/solver/footprint.h"
#include "baker/trace/gather_surface.h"

namespace kiln::solver::gather {
namespace {

constexpr std::uint32_t kPoints = Footprint::kPoints;
/// A point needs this many rays before it can be called hidden.
constexpr std::uint32_t kProbeRays = 4;

void set_plane(const float (&from)[3][16], float (&x)[16], float (&y)[16], float (&z)[16]) {
  std::memcpy(x, from[0], sizeof x);
  std::memcpy(y, from[1], sizeof y);
  std::memcpy(z, from[2], sizeof z);
}

/// The random numbers of one texel. Sample s is in packet s / 16 of the texel, whoever traces it.
struct TexelSamples {
  std::uint32_t seed_x = 0, seed_y = 0;

  TexelSamples() = default;
  explicit TexelSamples(std::uint32_t seed) : seed_x(seed), seed_y(sampling::hash(seed)) {}

  void begin_packet(std::uint32_t packet) {
    const std::uint32_t key = sampling::hash(seed_x, packet);
    turn_ = (key >> 4) % 16, jitter_ = sampling::to_unit(sampling::hash(key, 1));
  }
  /// Returns the random number for the choice of a tap at the hit of point `p`. It is stratified
  /// over the packet, whose rays meet neighboring texels when it is coherent.
  float pick(std::uint32_t p) const { return (float(p ^ turn_) + jitter_) * (1.f / 16); }

 private:
  std::uint32_t turn_ = 0;
  float jitter_ = 0;
};

}  // namespace

/// Counts what the rays from each point of a footprint met.
struct Hemisphere::BackfaceTally {
  std::uint32_t rays[kPoints] = {}, behind[kPoints] = {};

  bool met_backs() const { return std::any_of(behind, behind + kPoints, std::identity()); }
  float visible_share() const {
    std::uint32_t hidden = 0;
    for (std::uint32_t i = 0; i < kPoints; ++i) hidden += rays[i] > 0 && behind[i] == rays[i];
    return 1 - float(hidden) / kPoints;
  }
};

/// Follows directions of the texels of one tile.
class Hemisphere::Tracer {
 public:
  Tracer(const Hemisphere& all, const sampling::DirectionSet& set, std::uint32_t tile)
      : world_(all.world_),
        kernels_(all.kernels_),
        plan_(all.plan_),
        set_(set),
        sky_(all.world_.lights.sky()),
        shares_(sky_shares(all.world_.plan)),
        surface_(all.world_.rays, all.world_.lookup),
        tile_seed_(texel_seed(all.world_, tile, SampleStream::kGatherTile)) {
    points_.shared_x = plan_.shared_x(), points_.shared_y = plan_.shared_y();
    points_.shared_seed_x = sampling::hash(tile_seed_, 1),
    points_.shared_seed_y = sampling::hash(tile_seed_, 2);
    std::fill_n(rays_.t_far, 16, std::numeric_limits<float>::infinity());
  }

  /// Follows one texel; lane = point of its footprint.
  BackfaceTally trace_texel(Gathering& of) {
    const simd::PointFrames frames = Footprint(world_, of.texel).frames();
    TexelSamples own(texel_seed(world_, of.texel, SampleStream::kGather));
    std::fill_n(points_.seed_x, 16, own.seed_x);
    std::fill_n(points_.seed_y, 16, own.seed_y);
    BackfaceTally tally;
    for (std::uint32_t first = 0; first < set_.size(); first += 16) {
      const std::uint32_t flip = flip_of(first);
      std::uint32_t lanes = 0, sample[16];
      own.begin_packet(packet_of(first));
      for (std::uint32_t i = 0; i < 16; ++i) {
        sample[i] = first + Footprint::sample_of(i ^ flip);
        points_.x[i] = set_.x[sample[i]], points_.y[i] = set_.y[sample[i]];
        pick_[i] = own.pick(i);
        lanes |= std::uint32_t(sample[i] < set_.size()) << i;
      }
      trace(frames, lanes, set_.coherent);
      for (std::uint32_t i = 0; i < 16; ++i)
        if (lanes >> i & 1) take(i, i, sample[i], of, tally);
    }
    return tally;
  }

  /// Follows up to sixteen texels with one direction each, or four with four: lane = texel * strata
  /// + stratum.
  void trace_together(std::span<Gathering> group, std::span<BackfaceTally> tally) {
    const std::uint32_t texels = plan_.texels(), strata = 16 / texels;
    const auto last = std::uint32_t(group.size() - 1);
    std::array<TexelSamples, 16> own;
    std::uint32_t used = 0;
    for (std::uint32_t i = 0; i < 16; ++i) {
      const std::uint32_t t = std::min(i / strata, last);
      if (i % strata == 0)
        own[t] = TexelSamples(texel_seed(world_, group[t].texel, SampleStream::kGather));
      points_.seed_x[i] = own[t].seed_x, points_.seed_y[i] = own[t].seed_y;
      used |= std::uint32_t(i / strata <= last) << i;
    }
    transpose(group, strata);
    for (std::uint32_t first = 0; first < set_.size(); first += 16) {
      const std::uint32_t flip = flip_of(first);
      for (std::uint32_t t = 0; t <= last; ++t) own[t].begin_packet(packet_of(first));
      for (std::uint32_t run = 0; run < texels; ++run) {
        std::uint32_t lanes = 0, sample[16];
        for (std::uint32_t i = 0; i < 16; ++i) {
          const std::uint32_t point = run * strata + i % strata;
          sample[i] = first + Footprint::sample_of(point ^ flip);
          points_.x[i] = set_.x[sample[i]], points_.y[i] = set_.y[sample[i]];
          pick_[i] = own[std::min(i / strata, last)].pick(point);
          lanes |= std::uint32_t(sample[i] < set_.size()) << i;
        }
        lanes &= used;
        if (lanes == 0) continue;
        trace(frames_[run], lanes, true);
        for (std::uint32_t i = 0; i < 16; ++i)
          if (lanes >> i & 1)
            take(i, run * strata + i % strata, sample[i], group[i / strata], tally[i / strata]);
      }
    }
  }

 private:
  std::uint32_t packet_of(std::uint32_t first) const { return set_.first + first; }
  /// Point p of a footprint sends direction sample_of(p ^ flip) of a packet: which point goes with
  /// which direction differs from packet to packet.
  std::uint32_t flip_of(std::uint32_t first) const {
    return sampling::hash(tile_seed_, 3, packet_of(first)) % 16;
  }

  /// The frames of the points of a group, run by run of `strata` points, a texel's lanes together.
  void transpose(std::span<const Gathering> group, std::uint32_t strata) {
    for (std::uint32_t t = 0; t < 16 / strata; ++t) {
      if (t < group.size()) of_texel_ = Footprint(world_, group[t].texel).frames();
      const auto deal = [&](const float(&from)[3][16], float(simd::PointFrames::*to)[3][16]) {
        for (std::uint32_t p = 0; p < kPoints; ++p)
          for (int k = 0; k < 3; ++k)
            (frames_[p / strata].*to)[k][t * strata + p % strata] = from[k][p];
      };
      deal(of_texel_.origin, &simd::PointFrames::origin);
      deal(of_texel_.geometric_normal, &simd::PointFrames::geometric_normal);
      deal(of_texel_.tangent_x, &simd::PointFrames::tangent_x);
      deal(of_texel_.tangent_y, &simd::PointFrames::tangent_y);
      deal(of_texel_.shading_normal, &simd::PointFrames::shading_normal);
    }
  }

  void trace(const simd::PointFrames& frames, std::uint32_t lanes, bool coherent) {
    from_ = &frames;
    kernels_.directions(points_, frames, to_);
    set_plane(frames.origin, rays_.org_x, rays_.org_y, rays_.org_z);
    set_plane(to_.direction, rays_.dir_x, rays_.dir_y, rays_.dir_z);
    rays_.active = 0;
    for (std::uint32_t i = 0; i < 16; ++i) rays_.active |= std::uint32_t(to_.above[i] > 0) << i;
    rays_.active &= lanes;
    surface_.meet(rays_, pick_, coherent, met_);
  }

  /// Records what lane i brought.
  void take(std::uint32_t i, std::uint32_t point, std::uint32_t sample, Gathering& of,
            BackfaceTally& tally) {
    std::uint32_t& hit = of.hits[sample];
    hit = simd::kHitNothing;
    if (!(rays_.active >> i & 1)) return;
    hit = met_.element[i];
    if (sky_ && hit == simd::kHitSky) of.sky[set_.in_second_half(sample)] += sky_in(i);
    ++tally.rays[point];
    tally.behind[point] += hit == simd::kHitNothing && met_.hits.back[i];
  }

  /// Returns what lane i sees of a sky map.
  math::Rgb sky_in(std::uint32_t i) const {
    const auto lane = [i](const float(&v)[3][16]) { return math::Vec3{v[0][i], v[1][i], v[2][i]}; };
    const math::Vec3 d = lane(to_.direction);
    const light::SkyLight::Seen seen = sky_->seen(d);
    const float cosine = std::max(0.f, dot(lane(from_->shading_normal), d));
    return seen.radiance * shares_.of_cosine(seen.density, cosine);
  }

  const World& world_;
  const simd::Kernels& kernels_;
  const PacketLayout& plan_;
  const sampling::DirectionSet& set_;
  const light::SkyLight* const sky_;  ///< null: it is uniform
  const light::SkyShares shares_;
  const trace::TexelSurface surface_;
  const std::uint32_t tile_seed_;
  simd::ScrambledPoints points_;
  const simd::PointFrames* from_ = nullptr;  ///< frames of the rays that were traced last
  simd::PointFrames of_texel_{};
  std::array<simd::PointFrames, 16> frames_;
  trace::RayPacket rays_;
  trace::Gathered met_;
  simd::Directions to_;
  alignas(64) float pick_[16];
};

Hemisphere::Hemisphere(const World& world, const PacketLayout& plan)
    : world_(world),
      plan_(plan),
      kernels_(simd::kernels()),
      probe_(0, kProbeRays * kPoints, false) {}

void Hemisphere::follow(std::span<Gathering> texels, const sampling::DirectionSet& set) const {
  std::array<BackfaceTally, kTileTexels> ignored;
  trace(texels, set, ignored);
}

void Hemisphere::follow_and_probe(std::span<Gathering> texels,
                                  const sampling::DirectionSet& set) const {
  std::array<BackfaceTally, kTileTexels> tally;
  trace(texels, set, tally);
  for (std::size_t i = 0; i < texels.size(); ++i) {
    texels[i].visible = 1;
    if (!tally[i].met_backs()) continue;
    if (set.size() < probe_.size()) {
      std::array<std::uint32_t, kProbeRays * kPoints> hits;
      Gathering probed{texels[i].texel, hits};
      tally[i] = Tracer(*this, probe_, probed.texel / kTileTexels).trace_texel(probed);
    }
    texels[i].visible = tally[i].visible_share();
  }
}

sampling::Estimate Hemisphere::sky_light(const sampling::DirectionSet& of,
                                         const Gathering& g) const {
  if (world_.lights.sky()) return of.estimate(g.sky[0] * math::kPi, g.sky[1] * math::kPi);
  float open[2] = {0, 0};
  for (std::uint32_t i = 0; i < g.hits.size(); ++i)
    open[of.in_second_half(i)] += g.hits[i] == simd::kHitSky ? math::kPi : 0.f;
  return of.estimate(world_.scene.sky * open[0], world_.scene.sky * open[1]);
}

void Hemisphere::trace(std::span<Gathering> texels, const sampling::DirectionSet& set,
                       std::span<BackfaceTally> tally) const {
  if (texels.empty()) return;
  Tracer tracer(*this, set, texels.front().texel / kTileTexels);
  const std::size_t together = plan_.texels();
  std::size_t done = 0;
  // Half-empty packets cost as much as full ones.
  while (together > 1 && texels.size() - done >= together / 2) {
    const std::size_t n = std::min(together, texels.size() - done);
    tracer.trace_together(texels.subspan(done, n), tally.subspan(done, n));
    done += n;
  }
  for (; done < texels.size(); ++done) tally[done] = tracer.trace_texel(texels[done]);
}

}  // namespace kiln::solver::gather
