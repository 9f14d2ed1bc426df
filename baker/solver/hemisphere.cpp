#include "baker/solver/hemisphere.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <limits>

#include "baker/solver/footprint.h"
#include "baker/solver/sobol.h"

namespace kiln::baker {
namespace {

/// Rays that a point needs before it can be called hidden.
constexpr std::uint32_t kProbeRays = 4;

void set_plane(const float (&from)[3][16], float (&x)[16], float (&y)[16], float (&z)[16]) {
  std::memcpy(x, from[0], sizeof x);
  std::memcpy(y, from[1], sizeof y);
  std::memcpy(z, from[2], sizeof z);
}

}  // namespace

/// What the rays from each point of a footprint met.
struct Hemisphere::Census {
  std::uint32_t rays[Footprint::kPoints] = {}, behind[Footprint::kPoints] = {};

  bool met_backs() const {
    return std::any_of(behind, behind + Footprint::kPoints, std::identity());
  }
  float visible_share() const {
    std::uint32_t hidden = 0;
    for (std::uint32_t i = 0; i < Footprint::kPoints; ++i)
      hidden += rays[i] > 0 && behind[i] == rays[i];
    return 1 - float(hidden) / Footprint::kPoints;
  }
};

Hemisphere::Hemisphere(const SolverInput& in)
    : in_(in), kernels_(kernels()), probe_(0, kProbeRays * Footprint::kPoints) {}

void Hemisphere::follow(std::uint32_t texel, const DirectionSet& set,
                        std::span<std::uint32_t> hits) const {
  trace(texel, set, hits);
}

float Hemisphere::follow_and_probe(std::uint32_t texel, const DirectionSet& set,
                                   std::span<std::uint32_t> hits) const {
  const Census census = trace(texel, set, hits);
  if (!census.met_backs()) return 1;
  if (set.size() >= probe_.size()) return census.visible_share();
  std::array<std::uint32_t, kProbeRays * Footprint::kPoints> ignored;
  return trace(texel, probe_, ignored).visible_share();
}

Hemisphere::Census Hemisphere::trace(std::uint32_t texel, const DirectionSet& set,
                                     std::span<std::uint32_t> hits) const {
  const PointFrames frames = Footprint(in_, texel).frames();
  const TexelGrid grid = in_.lookup.grid();
  const std::uint32_t seed = texel_seed(in_, texel, Purpose::kGather), seed_y = hash(seed);
  Census census;
  RayPacket rays;
  HitPacket met;
  Directions to;
  alignas(64) std::uint32_t found[16];
  alignas(64) float pick[16];
  set_plane(frames.origin, rays.org_x, rays.org_y, rays.org_z);
  std::fill_n(rays.t_far, 16, std::numeric_limits<float>::infinity());
  for (std::uint32_t first = 0; first < set.size(); first += 16) {
    // Lane i is point i of the footprint, with direction i ^ flip of the packet: which point goes
    // with which direction differs from packet to packet.
    const std::uint32_t key = hash(seed, set.first + first), flip = key % 16;
    kernels_.directions(&set.x[first], &set.y[first], flip, seed, seed_y, frames, to);
    set_plane(to.direction, rays.dir_x, rays.dir_y, rays.dir_z);
    rays.active = 0;
    for (std::uint32_t i = 0; i < 16; ++i)
      rays.active |= std::uint32_t(to.above[i] > 0 && first + (i ^ flip) < set.size()) << i;
    in_.rays.closest(rays, met, set.coherent);
    // Stratified over the packet, whose rays meet neighbouring texels when it is coherent.
    const float jitter = to_unit(hash(key, 1));
    for (std::uint32_t i = 0; i < 16; ++i)
      pick[i] = (float(i ^ (key >> 4) % 16) + jitter) * (1.f / 16);
    kernels_.look_up(grid, met.triangle, met.u, met.v, met.back, pick, found);
    for (std::uint32_t i = 0; i < 16; ++i) {
      const std::uint32_t sample = first + (i ^ flip);
      if (sample >= set.size()) continue;
      const bool active = rays.active >> i & 1;
      if (active && found[i] == kHitUnclear) {
        const std::int32_t t =
            in_.lookup.pick(met.triangle[i], {met.u[i], met.v[i]}, met.back[i] != 0, pick[i]);
        found[i] = t != kNoTexel ? static_cast<std::uint32_t>(t) : kHitNothing;
      }
      hits[sample] = active ? found[i] : kHitNothing;
      census.rays[i] += active;
      census.behind[i] += active && found[i] == kHitNothing && met.back[i];
    }
  }
  return census;
}

}  // namespace kiln::baker
