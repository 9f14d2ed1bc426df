#include "baker/solver/directional/tile_rays.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "baker/sampling/sobol.h"
#include "baker/simd/kernels.h"
#include "baker/solver/footprint.h"
#include "baker/trace/gather_surface.h"

namespace kiln::solver::directional {
namespace {

constexpr std::uint32_t kPoints = Footprint::kPoints;
/// A point needs this many rays before it can be called hidden.
constexpr std::uint32_t kProbeRays = 4;
/// RTRad's program drops what rays meet nearer than this; its scenes reach from -1 to 1.
constexpr float kRtradNear = 0.1f;

float half_longest_side(const scene::Scene& scene) {
  constexpr float kEnd = std::numeric_limits<float>::max();
  math::Vec3 low{kEnd, kEnd, kEnd}, high{-kEnd, -kEnd, -kEnd};
  for (const math::Vec3 p : scene.positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  return math::max_abs(high - low) / 2;
}

/// Returns the angle by which a texel turns the set, in turns: the two-dimensional golden sequence,
/// whose neighbors on a page differ [Roberts, "The Unreasonable Effectiveness of Quasirandom
/// Sequences", 2018], begun at a random number for each page and side.
float turn_of(const World& world, std::uint32_t texel) {
  constexpr std::uint32_t kX = 3242174889u, kY = 2447445414u;  // of 2^32
  const atlas::TextureGroup& all = world.texels;
  const std::uint32_t page = 2u * all.page[texel] + all.is_back(texel);
  const std::uint32_t start = texel_seed(world, page, SampleStream::kDirectional);
  return sampling::to_unit(start + kX * all.x[texel] + kY * all.y[texel]);
}

}  // namespace

/// The texels of one packet.
class TileRays::Group {
 public:
  Group(const TileRays& of, std::uint32_t first, std::uint32_t count)
      : of_(of),
        surface_(of.world_.rays, of.world_.lookup),
        used_((1u << count) - 1),
        count_(count) {
    std::fill_n(rays_.t_far, 16, std::numeric_limits<float>::infinity());
    for (std::uint32_t lane = 0; lane < kTexels; ++lane)
      place(lane, first + std::min(lane, count - 1));
  }

  void follow() {
    for (const RingOrder::Ring& ring : of_.order_.rings) {
      std::uint32_t at[kTexels];
      for (std::uint32_t lane = 0; lane < kTexels; ++lane)
        at[lane] = RingOrder::start_of(ring, turn_[lane]);
      for (std::uint32_t k = 0; k < ring.size; ++k) {
        const std::uint32_t number = ring.begin + k;
        for (std::uint32_t lane = 0; lane < kTexels; ++lane) {
          direction_[lane] = ring.begin + at[lane];
          at[lane] = at[lane] + 1 < ring.size ? at[lane] + 1 : 0;
        }
        trace(number);
      }
    }
  }

  Gathered result(std::uint32_t lane) const {
    Gathered g;
    const float* sum = sum_[lane];
    g.light = {{sum[0], sum[1], sum[2]}, sum[3]};
    if (of_.order_.set.size() < kProbeRays * kPoints) return g;
    std::uint32_t hidden = 0;
    for (std::uint32_t p = 0; p < kPoints; ++p)
      hidden += sent_[lane][p] > 0 && behind_[lane][p] == sent_[lane][p];
    g.visible = 1 - float(hidden) / kPoints;
    return g;
  }

 private:
  /// Puts a texel into a lane, its tangents turned.
  void place(std::uint32_t lane, std::uint32_t texel) {
    const simd::PointFrames frames = Footprint(of_.world_, texel).frames();
    const bool turns = of_.world_.settings.rotate_directions;
    turn_[lane] = turns ? turn_of(of_.world_, texel) : 0;
    const float angle = 2 * math::kPi * turn_[lane], c = std::cos(angle), s = std::sin(angle);
    // The texel of the look-up's four is drawn by a golden sequence that each texel begins anew.
    pick_[lane] = turns ? texel_seed(of_.world_, texel, SampleStream::kDirectional) : 0;
    for (std::uint32_t p = 0; p < kPoints; ++p) {
      Frame& to = frames_[p];
      for (int k = 0; k < 3; ++k) {
        to.origin[k][lane] = frames.origin[k][p];
        to.geometric_normal[k][lane] = frames.geometric_normal[k][p];
        to.tangent_x[k][lane] = c * frames.tangent_x[k][p] + s * frames.tangent_y[k][p];
        to.tangent_y[k][lane] = c * frames.tangent_y[k][p] - s * frames.tangent_x[k][p];
        to.normal[k][lane] = frames.shading_normal[k][p];
      }
    }
  }

  /// Sends direction_[lane] from each texel, all from the same point of their footprints.
  void trace(std::uint32_t number) {
    // Each sixteen in a row take every point once. Which point goes with which direction differs
    // from one sixteen to the next, or each point would look to its own side.
    const std::uint32_t point = (number ^ sampling::hash(number / kPoints, 0x7064u)) % kPoints;
    const Frame& frame = frames_[point];
    const sampling::HemisphereSet& set = of_.order_.set;
    alignas(64) float local[3][kTexels], to[3][kTexels], above[kTexels], pick[kTexels];
    for (std::uint32_t i = 0; i < kTexels; ++i) {
      const std::uint32_t d = direction_[i];
      local[0][i] = set.x[d], local[1][i] = set.y[d], local[2][i] = set.z[d];
      pick[i] = sampling::to_unit(pick_[i] + number * 0x9e3779b9u);
      above[i] = 0;
    }
    for (int k = 0; k < 3; ++k)
      for (std::uint32_t i = 0; i < kTexels; ++i) {
        to[k][i] = frame.tangent_x[k][i] * local[0][i] + frame.tangent_y[k][i] * local[1][i] +
                   frame.normal[k][i] * local[2][i];
        above[i] += to[k][i] * frame.geometric_normal[k][i];
      }
    std::memcpy(rays_.org_x, frame.origin[0], sizeof rays_.org_x);
    std::memcpy(rays_.org_y, frame.origin[1], sizeof rays_.org_y);
    std::memcpy(rays_.org_z, frame.origin[2], sizeof rays_.org_z);
    std::memcpy(rays_.dir_x, to[0], sizeof rays_.dir_x);
    std::memcpy(rays_.dir_y, to[1], sizeof rays_.dir_y);
    std::memcpy(rays_.dir_z, to[2], sizeof rays_.dir_z);
    rays_.active = 0;
    for (std::uint32_t i = 0; i < kTexels; ++i) rays_.active |= std::uint32_t(above[i] > 0) << i;
    rays_.active &= used_;
    surface_.meet(rays_, pick, /*coherent=*/true, met_);
    for (std::uint32_t i = 0; i < count_; ++i)
      if (rays_.active >> i & 1) take(i, point);
  }

  /// Adds what lane i has met.
  void take(std::uint32_t i, std::uint32_t point) {
    const std::uint32_t hit = met_.element[i];
    ++sent_[i][point];
    if (hit >= simd::kHitSky) {  // or nothing
      behind_[i][point] += hit == simd::kHitNothing && met_.hits.back[i];
      return;
    }
    const std::uint32_t d = direction_[i];
    const float r2 = met_.hits.t[i] * met_.hits.t[i];
    const float spread = of_.reads_mips_ ? of_.order_.solid_angle[d] * r2 : 0;
    const math::Rgb b = of_.radiosity_.at(hit, spread);
    const float factor = of_.as_rtrad_ ? rtrad_factor(d, r2) : 1;
    const float weight = of_.order_.set.weight[d] * factor;
    float* sum = sum_[i];
    sum[0] += weight * b.r, sum[1] += weight * b.g, sum[2] += weight * b.b;
    sum[3] += of_.order_.set.contrast[d] * factor * luminance(b);
  }

  /// Returns cosθ/(π r²), and nothing for what is near [RTRad eq. 5.8, alg. 8]: the cosine that the
  /// density of the directions has already, and a square that belongs to areas.
  float rtrad_factor(std::uint32_t direction, float r2_m2) const {
    const float r2 = r2_m2 / (of_.rtrad_unit_m_ * of_.rtrad_unit_m_);
    return r2 < kRtradNear * kRtradNear ? 0 : of_.order_.set.z[direction] / (math::kPi * r2);
  }

  /// One point of all texels.
  struct alignas(64) Frame {
    float origin[3][kTexels], geometric_normal[3][kTexels];
    float tangent_x[3][kTexels], tangent_y[3][kTexels], normal[3][kTexels];
  };

  const TileRays& of_;
  const trace::TexelSurface surface_;
  const std::uint32_t used_, count_;  ///< lanes
  std::array<Frame, kPoints> frames_;
  float turn_[kTexels];
  std::uint32_t pick_[kTexels], direction_[kTexels];
  trace::RayPacket rays_;
  trace::Gathered met_;
  float sum_[kTexels][4] = {};  ///< light, and the half difference of its luminance
  std::uint32_t sent_[kTexels][kPoints] = {}, behind_[kTexels][kPoints] = {};
};

TileRays::TileRays(const World& world, const RingOrder& order, const RadiosityMips& radiosity)
    : world_(world),
      order_(order),
      radiosity_(radiosity),
      as_rtrad_(world.settings.rtrad_compat),
      reads_mips_(world.settings.mip_radiosity) {
  if (as_rtrad_) rtrad_unit_m_ = half_longest_side(world.scene);
}

std::array<Gathered, TileRays::kTexels> TileRays::follow(std::uint32_t first,
                                                         std::uint32_t count) const {
  Group group(*this, first, count);
  group.follow();
  std::array<Gathered, kTexels> all;
  for (std::uint32_t i = 0; i < count; ++i) all[i] = group.result(i);
  return all;
}

}  // namespace kiln::solver::directional
