// Included once per instruction set, with KILN_KERNELS naming the table to define. Nothing with
// external linkage may be called from here, inline or not: the linker keeps one copy of an inline
// function, and that copy must not be the one compiled for a newer machine.

#include "baker/simd/kernels.h"

namespace kiln::simd {
namespace {

constexpr int kLanes = 16;
constexpr std::uint32_t kLaneBit[kLanes] = {
    1u << 0, 1u << 1, 1u << 2,  1u << 3,  1u << 4,  1u << 5,  1u << 6,  1u << 7,
    1u << 8, 1u << 9, 1u << 10, 1u << 11, 1u << 12, 1u << 13, 1u << 14, 1u << 15};

[[gnu::always_inline]] inline std::uint32_t reverse(std::uint32_t x) {
  x = (x << 16) | (x >> 16);
  x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
  x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
  return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
}

/// owen_scramble() of sobol.h.
[[gnu::always_inline]] inline std::uint32_t scramble(std::uint32_t fraction, std::uint32_t seed) {
  std::uint32_t x = reverse(fraction);
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverse(x);
}

[[gnu::always_inline]] inline float unit(std::uint32_t fraction) {
  return float(std::int32_t(fraction >> 8)) * 0x1p-24f;
}

[[gnu::always_inline]] inline float magnitude(float x) {
  return x < 0 ? -x : x;
}
[[gnu::always_inline]] inline float larger(float a, float b) {
  return a > b ? a : b;
}

void directions(const ScrambledPoints& points, const PointFrames& frames, Directions& out) {
  alignas(64) std::uint32_t px[kLanes], py[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    px[i] = scramble(points.x[i], points.seed_x[i]);
    py[i] = scramble(points.y[i], points.seed_y[i]);
  }
  if ((points.shared_x | points.shared_y) != 0) {
    const std::uint32_t shared_x = points.shared_x, shared_y = points.shared_y;
    const std::uint32_t seed_x = points.shared_seed_x, seed_y = points.shared_seed_y;
    for (int i = 0; i < kLanes; ++i) {
      px[i] = (scramble(points.x[i], seed_x) & shared_x) | (px[i] & ~shared_x);
      py[i] = (scramble(points.y[i], seed_y) & shared_y) | (py[i] & ~shared_y);
    }
  }
  for (int i = 0; i < kLanes; ++i) {
    // Concentric map of the square to the disk, then up to the hemisphere. Its angle stays within
    // an eighth of a turn, where short Taylor series are exact to the last bit or two.
    const float a = 2 * unit(px[i]) - 1, b = 2 * unit(py[i]) - 1;
    const bool wide = magnitude(a) > magnitude(b);
    const float r = wide ? a : b, other = wide ? b : a;
    const float angle = 0.78539816339744831f * (other / (r == 0 ? 1.f : r));
    const float q = angle * angle;
    const float sine =
        angle *
        (1 + q * (-1.6666667e-1f + q * (8.3333333e-3f + q * (-1.9841270e-4f + q * 2.7557319e-6f))));
    const float cosine =
        1 + q * (-0.5f + q * (4.1666667e-2f +
                              q * (-1.3888889e-3f + q * (2.4801587e-5f - q * 2.7557319e-7f))));
    const float dx = r * (wide ? cosine : sine), dy = r * (wide ? sine : cosine);
    const float rest = 1 - r * r;
    const float dz = __builtin_sqrtf(rest > 0 ? rest : 0.f);
    float above = 0;
    for (int k = 0; k < 3; ++k) {
      const float d = frames.tangent_x[k][i] * dx + frames.tangent_y[k][i] * dy +
                      frames.shading_normal[k][i] * dz;
      out.direction[k][i] = d;
      above += d * frames.geometric_normal[k][i];
    }
    out.above[i] = above;
  }
}

/// The angle of the cosine `x` over its sine, to 3e-7 relative: a least-squares fit on [0, 1],
/// reflected. The sine is given, since 1 - x^2 loses it where the angle is nearly straight.
[[gnu::always_inline]] inline float angle_over_sine(float x, float sine) {
  const float a = magnitude(x);
  const float p = 1.570796251e+00f +
                  a * (-9.999822378e-01f +
                       a * (7.848962545e-01f +
                            a * (-6.610894799e-01f +
                                 a * (5.570220351e-01f +
                                      a * (-4.245661795e-01f +
                                           a * (2.532384694e-01f + a * (-9.796870500e-02f +
                                                                        a * 1.765366830e-02f)))))));
  return x < 0 ? 3.14159265358979324f / (sine > 1e-12f ? sine : 1e-12f) - p : p;
}

void view_light(const LightShape& light, const PointFrames& frames, LightView& view) {
  const int last = light.corners - 1;
  for (int i = 0; i < kLanes; ++i) {
    const float px = frames.position[0][i], py = frames.position[1][i], pz = frames.position[2][i];
    const float nx = frames.shading_normal[0][i], ny = frames.shading_normal[1][i],
                nz = frames.shading_normal[2][i];
    const float gx = frames.geometric_normal[0][i], gy = frames.geometric_normal[1][i],
                gz = frames.geometric_normal[2][i];
    float vx[4], vy[4], vz[4];
    float lowest = 1;
    for (int k = 0; k < 4; ++k) {
      const int c = k < last ? k : last;  // a triangle's last corner counts twice
      const float x = light.corner[c][0] - px, y = light.corner[c][1] - py,
                  z = light.corner[c][2] - pz;
      const float length2 = x * x + y * y + z * z;
      const float s = 1 / __builtin_sqrtf(length2 > 1e-30f ? length2 : 1e-30f);
      vx[k] = x * s, vy[k] = y * s, vz[k] = z * s;
      const float n = nx * vx[k] + ny * vy[k] + nz * vz[k];
      const float g = gx * vx[k] + gy * vy[k] + gz * vz[k];
      lowest = n < lowest ? n : lowest;
      lowest = g < lowest ? g : lowest;
    }
    float sum = 0;
    for (int k = 0; k < 4; ++k) {
      const int m = (k + 1) % 4;
      const float cx = vy[k] * vz[m] - vz[k] * vy[m], cy = vz[k] * vx[m] - vx[k] * vz[m],
                  cz = vx[k] * vy[m] - vy[k] * vx[m];
      const float cosine = vx[k] * vx[m] + vy[k] * vy[m] + vz[k] * vz[m];
      const float sine = __builtin_sqrtf(cx * cx + cy * cy + cz * cz);
      sum += (cx * nx + cy * ny + cz * nz) * angle_over_sine(cosine, sine);
    }
    view.irradiance[i] = magnitude(sum) / 2;
    view.lowest[i] = lowest;
    view.height[i] = (px - light.corner[0][0]) * light.normal[0] +
                     (py - light.corner[0][1]) * light.normal[1] +
                     (pz - light.corner[0][2]) * light.normal[2];
  }
}

void sample_light(const LightShape& light, const std::uint32_t* __restrict x,
                  const std::uint32_t* __restrict y, std::uint32_t flip, std::uint32_t seed_x,
                  std::uint32_t seed_y, const PointFrames& frames, float clearance,
                  LightRays& out) {
  alignas(64) std::uint32_t px[kLanes], py[kLanes];
  for (int i = 0; i < kLanes; ++i) px[i] = x[i ^ flip], py[i] = y[i ^ flip];
  const bool triangle = light.corners == 3;
  const int opposite = triangle ? 2 : 3;
  // This is read here, since a read under the condition below would keep the loop from being
  // vectorized.
  const float area = light.area_m2;
  for (int i = 0; i < kLanes; ++i) {
    const float u = unit(scramble(px[i], seed_x)), v = unit(scramble(py[i], seed_y));
    // Uniform in a triangle by the square-root map.
    const float root = __builtin_sqrtf(u);
    const float b = triangle ? root * (1 - v) : u, c = triangle ? root * v : v;
    float d[3], end[3];
    float length2 = 0, at_light = 0, at_surface = 0, above = 0, height = 0;
    for (int k = 0; k < 3; ++k) {
      const float first = light.corner[0][k];
      const float point =
          first + b * (light.corner[1][k] - first) + c * (light.corner[opposite][k] - first);
      d[k] = point - frames.position[k][i];
      end[k] = point - frames.origin[k][i];
      length2 += d[k] * d[k];
      at_light += d[k] * light.normal[k];
      at_surface += d[k] * frames.shading_normal[k][i];
      above += d[k] * frames.geometric_normal[k][i];
      height += (frames.position[k][i] - first) * light.normal[k];
    }
    const float quarter = magnitude(height) / 4;
    const float off = quarter < clearance ? quarter : clearance;
    const float side = height < 0 ? -off : off;
    for (int k = 0; k < 3; ++k) out.direction[k][i] = end[k] + side * light.normal[k];
    const bool lit = (above > 0) & (at_surface > 0);
    const float safe = length2 > 1e-30f ? length2 : 1e-30f;
    out.weight[i] = lit ? magnitude(at_light) * at_surface / (safe * safe) * area : 0.f;
  }
}

void weigh_lights(const LightGroup* __restrict lights, std::uint32_t groups,
                  const Viewpoint& from, float* __restrict weight,
                  std::uint32_t* __restrict near) {
  constexpr float kNearRadii = 2;  // within so many radii of its own a light is no point
  const float px = from.point[0], py = from.point[1], pz = from.point[2];
  const float nx = from.normal[0], ny = from.normal[1], nz = from.normal[2];
  const float extent = from.extent, reach = from.reach;
  for (std::uint32_t g = 0; g < groups; ++g) {
    const LightGroup& l = lights[g];
    float* __restrict w = weight + std::size_t(g) * kLanes;
    alignas(64) std::uint32_t bit[kLanes];
    for (int i = 0; i < kLanes; ++i) {
      const float dx = l.center[0][i] - px, dy = l.center[1][i] - py, dz = l.center[2][i] - pz;
      const float r = l.radius[i];
      const float d2 = dx * dx + dy * dy + dz * dz;
      const float slope = -(dx * l.normal[0][i] + dy * l.normal[1][i] + dz * l.normal[2][i]);
      const float other = slope * l.back[i];
      const float height = slope > other ? slope : other;
      const float up = dx * nx + dy * ny + dz * nz;
      // The mean of what is above a horizon of a rod of that half width.
      const float wide = r + extent;
      const float above = up + wide > 0 ? up + wide : 0;
      const float in_part = above * above / (4 * wide + 1e-30f);
      const float facing = up >= wide ? up : in_part;
      const float before = height + extent > 0 ? height + extent : 0;
      const float before_in_part = before * before / (4 * extent + 1e-30f);
      const float towards = height >= extent ? height : before_in_part;
      const float bound = kNearRadii * r + reach;
      const bool is_near = d2 < bound * bound;
      // All operands are at hand before the choices, or they would be branches.
      const float seen = !is_near ? towards : 0.f;
      const float safe = d2 > 1e-30f ? d2 : 1e-30f;
      const float scale = 1 / safe;
      w[i] += (facing * scale) * (seen * scale) * l.power[i];
      bit[i] = kLaneBit[i] & (is_near ? 0xffffffffu : 0u);
    }
    std::uint32_t bits = 0;
    for (int i = 0; i < kLanes; ++i) bits |= bit[i];
    near[g] = bits;
  }
}

void look_up(const TexelGrid& grid, const std::uint32_t* __restrict triangle,
             const float* __restrict bary_u, const float* __restrict bary_v,
             const std::uint32_t* __restrict back, const float* __restrict u,
             std::uint32_t* __restrict hit) {
  const PlacedTriangle* __restrict placed = grid.triangles;
  const std::int32_t* __restrict cells = grid.cells;
  const std::int32_t width = grid.width;
  const float last = float(width - 2);
  alignas(64) std::int32_t index[kLanes];
  for (int i = 0; i < kLanes; ++i)
    index[i] = triangle[i] != 0xffffffffu ? std::int32_t(triangle[i]) : 0;
  for (int i = 0; i < kLanes; ++i) {
    const bool met = triangle[i] != 0xffffffffu;
    const std::int32_t t = index[i];
    const PlacedTriangle& p = placed[t];
    const float x = p.first[0] + bary_u[i] * p.to_second[0] + bary_v[i] * p.to_third[0] - 0.5f;
    const float y = p.first[1] + bary_u[i] * p.to_second[1] + bary_v[i] * p.to_third[1] - 0.5f;
    // Blocks across the rim are never whole, so clamping only keeps reads in bounds; of lanes that
    // met nothing too, whose coordinates may be anything, even NaN.
    const float cx = x > 0 ? (x < last ? x : last) : 0, cy = y > 0 ? (y < last ? y : last) : 0;
    const std::int32_t ix = std::int32_t(cx), iy = std::int32_t(cy);
    const float fx = x - float(ix), fy = y - float(iy);
    const bool right = u[i] < fx;
    const float left_over = (right ? u[i] : u[i] - fx) / (right ? fx : 1 - fx);
    const bool down = left_over < fy;
    const std::int32_t corner = p.page + iy * width + ix;
    const std::int32_t cell = cells[corner];
    const std::int32_t tap = cells[corner + (down ? width : 0) + (right ? 1 : 0)];
    const bool double_sided = p.double_sided != 0, behind = back[i] != 0;
    const bool inside = (fx >= 0) & (fx <= 1) & (fy >= 0) & (fy <= 1);
    const bool clear = (cell >= TexelGrid::kWhole) & inside & !(behind & double_sided);
    std::uint32_t h = clear ? std::uint32_t(tap & (TexelGrid::kWhole - 1)) : kHitUnclear;
    h = behind & !double_sided ? kHitNothing : h;
    hit[i] = met ? h : kHitSky;
  }
}

void exchange(const PatchColumns& one, std::uint32_t at, const PatchColumns& others,
              std::uint32_t first, const ExchangeRule& rule, Exchange& __restrict out) {
  constexpr float kSamePlace = 1e-30f;  // m²
  constexpr std::uint32_t kAll = 0xffffffffu;
  float p[3], g[3], n[3];
  const float *__restrict to[3], *__restrict geometric[3], *__restrict shading[3];
  for (int k = 0; k < 3; ++k) {
    p[k] = one.position[k][at], g[k] = one.geometric_normal[k][at], n[k] = one.shading_normal[k][at];
    to[k] = others.position[k] + first;
    geometric[k] = others.geometric_normal[k] + first, shading[k] = others.shading_normal[k] + first;
  }
  const float *__restrict areas = others.area_m2 + first, *__restrict shares = others.visible + first;
  const std::int32_t *__restrict charts = others.chart + first, *__restrict xs = others.x + first,
                     *__restrict ys = others.y + first;
  const float area = one.area_m2[at], scale = rule.scale, share = one.visible[at],
              near_widths2 = rule.near_widths2;
  const std::int32_t chart = one.chart[at], px = one.x[at], py = one.y[at], window = rule.window;
  alignas(64) std::uint32_t gives[kLanes], takes[kLanes], near[kLanes];
  for (int i = 0; i < kLanes; ++i) {
    const float x = to[0][i] - p[0], y = to[1][i] - p[1], z = to[2][i] - p[2];
    const float r2 = x * x + y * y + z * z;
    const float above_one = g[0] * x + g[1] * y + g[2] * z;
    const float above_other = -(geometric[0][i] * x + geometric[1][i] * y + geometric[2][i] * z);
    const float along_one = n[0] * x + n[1] * y + n[2] * z;
    const float along_other = -(shading[0][i] * x + shading[1][i] * y + shading[2][i] * z);
    const std::int32_t dx = xs[i] - px, dy = ys[i] - py;
    const std::uint32_t is_excluded =
        (charts[i] == chart ? kAll : 0u) & (dx < window ? kAll : 0u) & (dx > -window ? kAll : 0u) &
        (dy < window ? kAll : 0u) & (dy > -window ? kAll : 0u);
    const std::uint32_t faces = (above_one > 0 ? kAll : 0u) & (above_other > 0 ? kAll : 0u) &
                                (r2 > kSamePlace ? kAll : 0u) & ~is_excluded;
    const float safe = r2 > kSamePlace ? r2 : 1.f;
    const float at_one = along_one > 0 ? along_one : 0.f;
    const float at_other = along_other > 0 ? along_other : 0.f;
    const float worth = scale * (share * shares[i]), other_area = areas[i];
    const float forth = (at_one / safe) * (above_other / safe) * worth * other_area;
    const float back = (at_other / safe) * (above_one / safe) * worth * area;
    const float ratio = other_area / area, inverse = area / other_area;
    const float most_forth = ratio < 1 ? ratio : 1.f, most_back = inverse < 1 ? inverse : 1.f;
    const float held_forth = forth < most_forth ? forth : most_forth;
    const float held_back = back < most_back ? back : most_back;
    const float larger = other_area > area ? other_area : area;
    out.forth[i] = faces != 0 ? held_forth : 0.f;
    out.back[i] = faces != 0 ? held_back : 0.f;
    gives[i] = kLaneBit[i] & faces & (held_forth > 0 ? kAll : 0u);
    takes[i] = kLaneBit[i] & faces & (held_back > 0 ? kAll : 0u);
    near[i] = kLaneBit[i] & (r2 < near_widths2 * larger ? kAll : 0u);
  }
  std::uint32_t all_give = 0, all_take = 0, all_near = 0;
  for (int i = 0; i < kLanes; ++i)
    all_give |= gives[i], all_take |= takes[i], all_near |= near[i];
  out.gives = all_give, out.takes = all_take, out.near = all_near;
}

void shorten(const float (*__restrict from)[kLanes], const float (*__restrict to)[kLanes],
             float least_offset, float offset, SegmentRays& __restrict out) {
  for (int i = 0; i < kLanes; ++i) {
    const float x = to[0][i] - from[0][i], y = to[1][i] - from[1][i], z = to[2][i] - from[2][i];
    float largest = 0;
    for (int k = 0; k < 3; ++k)
      largest = larger(largest, larger(magnitude(from[k][i]), magnitude(to[k][i])));
    const float piece = larger(largest * offset, least_offset);
    const float length = __builtin_sqrtf(x * x + y * y + z * z);
    const bool is_longer = length > 2 * piece;
    const float share = is_longer ? piece / length : 0.f;
    out.origin[0][i] = from[0][i] + x * share;
    out.origin[1][i] = from[1][i] + y * share;
    out.origin[2][i] = from[2][i] + z * share;
    out.direction[0][i] = x, out.direction[1][i] = y, out.direction[2][i] = z;
    out.far[i] = 1 - 2 * share;
    out.valid[i] = is_longer ? -1 : 0;
  }
}

}  // namespace

extern const Kernels KILN_KERNELS{
    KILN_KERNELS_NAME, directions, view_light, sample_light, weigh_lights, look_up,
    exchange,          shorten};

}  // namespace kiln::simd
