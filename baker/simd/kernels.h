#pragma once

#include <cstdint>

/// The inner loops of sampling, sixteen lanes at a time, compiled once per instruction set and
/// chosen at run time. All arithmetic is IEEE single precision without contraction, so every
/// version gives the same bits.
namespace kiln::simd {

/// Sixteen footprint points: positions, ray origins and shading frames, structure of arrays.
/// Lane = point.
struct alignas(64) PointFrames {
  float position[3][16], origin[3][16];
  float geometric_normal[3][16];
  float tangent_x[3][16], tangent_y[3][16], shading_normal[3][16];
};

struct alignas(64) Directions {
  float direction[3][16];  ///< unit
  float above[16];         ///< cosine to the geometric normal
};

/// Sixteen Sobol points (fractions of 2^32) and how they are Owen-scrambled: the bits of `shared`
/// by the seeds that all lanes share, those below by the lane's own.
struct alignas(64) ScrambledPoints {
  std::uint32_t x[16], y[16];
  std::uint32_t seed_x[16], seed_y[16];
  std::uint32_t shared_x = 0, shared_y = 0, shared_seed_x = 0, shared_seed_y = 0;
};

/// Cosine-distributed directions about each lane's shading normal.
using DirectionKernel = void (*)(const ScrambledPoints&, const PointFrames&, Directions&);

/// A flat light: a triangle, or a parallelogram (four corners, the last one opposite the second).
struct LightShape {
  float corner[4][3];  ///< m, counter-clockwise seen from the front
  float normal[3];     ///< unit
  float area_m2;
  std::int32_t corners;  ///< 3 or 4
};

/// A light as sixteen points see it.
struct alignas(64) LightView {
  float irradiance[16];  ///< at unit radiance, lx; wrong where the light crosses the horizon
  float lowest[16];      ///< smallest cosine of a corner to the shading or geometric normal
  float height[16];      ///< height of the point over the light's plane, m
};

/// Lambert's formula: irradiance from a uniform polygon, not clipped, unoccluded.
using ViewKernel = void (*)(const LightShape&, const PointFrames&, LightView&);

/// Shadow rays from sixteen points to points of a light that are uniform in area.
struct alignas(64) LightRays {
  float direction[3][16];  ///< from the origin to just before the light: t in (0, 1) must be free
  float weight[16];        ///< the sample's estimate of the irradiance at unit radiance
};

/// Lane i takes the Sobol point number i ^ flip of `x`, `y` (fractions of 2^32), Owen-scrambled by
/// the two seeds.
/// @param clearance distance off the light at which shadow rays end, m
using LightKernel = void (*)(const LightShape&, const std::uint32_t* x, const std::uint32_t* y,
                             std::uint32_t flip, std::uint32_t seed_x, std::uint32_t seed_y,
                             const PointFrames&, float clearance, LightRays&);

/// Sixteen flat lights.
struct alignas(64) LightGroup {
  float center[3][16], normal[3][16];
  float radius[16];  ///< from the center to the farthest corner, m
  float power[16];   ///< luminance times area, cd; 0 in lanes without a light
  float back[16];    ///< -1 where it shines to both sides, else 1
};

/// A point that stands for the surface around it.
struct Viewpoint {
  float point[3], normal[3];
  float extent;  ///< reach of that surface, m
  float reach;   ///< lights nearer than this and their own size are too near to be weighed so, m
};

/// Adds to `weight`, sixteen for each group, an estimate of what the surface around a viewpoint
/// gets from each of many lights if nothing stands between. A light across a horizon, the surface's
/// or its own, counts by the part of its width and the surface's that is not behind it. Where light
/// i of group g is too near, bit i of near[g] is set and nothing is added.
using WeighKernel = void (*)(const LightGroup*, std::uint32_t groups, const Viewpoint&,
                             float* weight, std::uint32_t* near);

/// The place of a triangle on its page, in texels. One cache line holds all that a look-up reads of
/// it.
struct alignas(32) PlacedTriangle {
  float first[2];  ///< u, v of the first corner
  float to_second[2], to_third[2];
  std::int32_t page = 0;  ///< its page's offset in TexelGrid::cells
  std::int32_t double_sided = 0;
};

/// The maps from triangles to pages and from pages to texels, as the look-up kernel reads them.
struct TexelGrid {
  static constexpr std::int32_t kWhole = 1 << 30;

  /// The cells of all pages in one row, row by row: the index of the texel, or -1. kWhole is added
  /// when one chart covers the whole block of the texel with its right, lower and diagonal
  /// neighbors.
  const std::int32_t* cells = nullptr;
  const PlacedTriangle* triangles = nullptr;
  std::int32_t width = 0;  ///< width of every page, texels
};

/// Values that look-ups return in place of a texel.
inline constexpr std::uint32_t kHitNothing = 0xffffffffu;  ///< a one-sided surface's back
inline constexpr std::uint32_t kHitSky = 0xfffffffeu;
inline constexpr std::uint32_t kHitUnclear = 0xfffffffdu;  ///< TexelLookup::pick decides

/// Maps sixteen hits to the texels that hold their light: one of the four around each, picked with
/// its bilinear weight by `u` in [0,1). Lanes with `triangle` 0xffffffff become kHitSky.
/// @param back non-zero when the hit was met from behind
using LookupKernel = void (*)(const TexelGrid&, const std::uint32_t* triangle, const float* bary_u,
                              const float* bary_v, const std::uint32_t* back, const float* u,
                              std::uint32_t* hit);

/// Patches, structure of arrays. Each is a point that stands for the surface around it.
struct PatchColumns {
  const float *position[3], *geometric_normal[3], *shading_normal[3];
  const float* area_m2;
  const float* visible;               ///< share that is not inside other geometry
  const std::int32_t *chart, *x, *y;  ///< place on the page, texels
};

/// Parameters of view factors.
struct ExchangeRule {
  float scale;         ///< factor on all of them
  float near_widths2;  ///< square of the distance, in widths of a patch, below which pairs are near
  std::int32_t
      window;  ///< patches of one chart nearer than this in x and y exchange nothing, texels
};

/// Holds what sixteen pairs of patches exchange if nothing stands between them.
struct alignas(64) Exchange {
  float forth[16];  ///< F of the first patch to the other: the share of its light from there
  float back[16];   ///< F of the other to the first
  std::uint32_t gives = 0, takes = 0;  ///< bit i: forth[i], or back[i], is above 0
  std::uint32_t near = 0;              ///< bit i: pair i is near
};

/// Pairs patch `i` of `one` with the patches [first, first + 16) of `others`:
///   F = min(scale v v' A' cosθ cosθ' / r², 1, A' / A)
/// Patches that turn away from each other exchange nothing. The cosine of the patch that gets light
/// is that of its shading normal.
using ExchangeKernel = void (*)(const PatchColumns& one, std::uint32_t i,
                                const PatchColumns& others, std::uint32_t first,
                                const ExchangeRule&, Exchange&);

/// Rays along sixteen segments, without a piece at either end.
struct alignas(64) SegmentRays {
  float origin[3][16], direction[3][16], far[16];
  std::int32_t valid[16];  ///< -1 where the segment is longer than the two pieces, else 0
};

/// Shortens segments at either end by `offset` times the largest coordinate of both ends, and at
/// least by `least_offset`, m. All lanes are finite, whether they are valid or not.
using SegmentKernel = void (*)(const float (*from)[16], const float (*to)[16], float least_offset,
                               float offset, SegmentRays&);

struct Kernels {
  const char* name;
  DirectionKernel directions;
  ViewKernel view_light;
  LightKernel sample_light;
  WeighKernel weigh_lights;
  LookupKernel look_up;
  ExchangeKernel exchange;
  SegmentKernel shorten;
};

enum class InstructionSet { kSse2, kAvx2, kAvx512 };

/// Returns the best version that this machine runs. Thread-safe.
const Kernels& kernels();
/// Returns a given version, which the machine must have (see best_instruction_set()).
const Kernels& kernels(InstructionSet);
InstructionSet best_instruction_set();

}  // namespace kiln::simd
