#include "baker/atlas/sample_points.h"

#include <array>
#include <cmath>

namespace kiln::atlas {
namespace {

constexpr int kPoints = int(TextureGroup::kPointsPerTexel);
static_assert(kPoints == 16, "the pattern below has four bits per axis");

/// The finalizer of SplitMix64.
std::uint64_t mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ull;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

/// The first 16 points of Sobol's sequence in two dimensions, as four-bit integers. They form a
/// (0,4,2)-net whose aligned runs of 4 are (0,2,2)-nets.
struct Net {
  std::array<std::uint8_t, kPoints> x{}, y{};
};
constexpr Net make_net() {
  constexpr std::uint8_t kX[4] = {8, 4, 2, 1}, kY[4] = {8, 12, 10, 15};
  Net net;
  for (int i = 0; i < kPoints; ++i) {
    for (int bit = 0; bit < 4; ++bit) {
      if (i >> bit & 1) net.x[i] ^= kX[bit], net.y[i] ^= kY[bit];
    }
  }
  return net;
}
constexpr Net kNet = make_net();

/// Returns the net in [0,1)^2, with its digits flipped and each point moved within its 1/16 x 1/16
/// cell by `seed`. It is still a net, and each point alone is uniform.
void scrambled_net(std::uint64_t seed, Point (&out)[kPoints]) {
  const std::uint64_t flips = mix(seed);
  const unsigned fx = unsigned(flips & 15), fy = unsigned(flips >> 4 & 15);
  for (int i = 0; i < kPoints; ++i) {
    const std::uint64_t r = mix(seed + 1 + std::uint64_t(i));
    const double jx = double(r & 0xffffff) * 0x1p-24, jy = double(r >> 40) * 0x1p-24;
    out[i] = {((kNet.x[i] ^ fx) + jx) / kPoints, ((kNet.y[i] ^ fy) + jy) / kPoints};
  }
}

/// Returns how far inside a barycentric point lies: 0 on an edge, negative outside.
double depth(Point bary) {
  return std::min({bary.x, bary.y, 1 - bary.x - bary.y});
}

Point clamp_bary(Point b) {
  b.x = std::clamp(b.x, 0.0, 1.0);
  b.y = std::clamp(b.y, 0.0, 1.0);
  if (const double sum = b.x + b.y; sum > 1) b.x /= sum, b.y /= sum;
  return b;
}

/// Places the points of a covered square: the net spans the square, and each point goes to the
/// triangle that it lies in.
void place_in_square(SetupCache& setups, Point corner, std::span<const Fragment> fragments,
                     const Point (&net)[kPoints], std::span<SamplePoint> points) {
  struct Choice {
    double depth = -INFINITY;
    std::uint32_t triangle = 0;
    Point bary;
  };
  std::array<Choice, kPoints> best;
  for (const Fragment& fragment : fragments) {
    const TriangleSetup& triangle = setups[fragment.triangle];
    for (int i = 0; i < kPoints; ++i) {
      const Point bary = triangle.bary({corner.x + net[i].x, corner.y + net[i].y});
      const double d = depth(bary);
      if (!(d <= best[i].depth)) best[i] = {d, fragment.triangle, bary};
    }
  }
  for (int i = 0; i < kPoints; ++i) points[i] = make_point(best[i].triangle, best[i].bary);
}

/// Maps (s, t), uniform in [0,1)^2, to a uniform point of the triangle abc. The area below the
/// point's line from `a` grows with s.
Point point_in(Point a, Point b, Point c, double s, double t) {
  const double r = std::sqrt(t);
  return {a.x + r * ((b.x - a.x) * (1 - s) + (c.x - a.x) * s),
          a.y + r * ((b.y - a.y) * (1 - s) + (c.y - a.y) * s)};
}

/// Places the points of a square that is covered in part. The footprint is a row of fan triangles
/// laid end to end along their summed area. The net's x picks the place along the row, its y the
/// place across.
void place_along_area(SetupCache& setups, std::uint32_t x, std::uint32_t y,
                      std::span<const Fragment> fragments, const Point (&net)[kPoints],
                      std::span<SamplePoint> points) {
  double total = 0;
  for (const Fragment& fragment : fragments) total += fragment.area;
  std::array<int, kPoints> order;  // sorted by place along the row; cells are distinct
  for (int i = 0; i < kPoints; ++i) order[int(net[i].x * kPoints)] = i;
  double sum = 0;
  int next = 0;
  for (const Fragment& fragment : fragments) {
    const TriangleSetup& triangle = setups[fragment.triangle];
    const Polygon polygon = clip_to_texel(triangle.polygon(), x, y);
    const bool last_fragment = &fragment == &fragments.back();
    for (int k = 1; k + 1 < polygon.n; ++k) {
      const Point a = polygon.v[0], b = polygon.v[k], c = polygon.v[k + 1];
      const double area = std::abs(cross(a, b, c)) / 2;
      const bool last = last_fragment && k + 2 == polygon.n;  // it takes what rounding left over
      for (; next < kPoints; ++next) {
        const int i = order[next];
        const double at = net[i].x * total - sum;
        if (at > area && !last) break;
        const double s = area > 0 ? std::clamp(at / area, 0.0, 1.0) : 0.5;
        points[i] = make_point(fragment.triangle, triangle.bary(point_in(a, b, c, s, net[i].y)));
      }
      sum += area;
    }
  }
  // Cutting out one texel rounds differently from cutting row by row, so a tiny last fragment may
  // be missing here.
  const TriangleSetup& first = setups[fragments.front().triangle];
  for (; next < kPoints; ++next) {
    points[order[next]] = next > 0 ? points[order[next - 1]]
                                   : make_point(fragments.front().triangle,
                                                first.bary({double(x) + 0.5, double(y) + 0.5}));
  }
}

}  // namespace

SamplePoint make_point(std::uint32_t triangle, Point bary) {
  const Point b = clamp_bary(bary);
  auto u = std::uint32_t(std::lround(b.x * 65535)), v = std::uint32_t(std::lround(b.y * 65535));
  if (u + v > 65535) --(u > v ? u : v);
  return {triangle, std::uint16_t(u), std::uint16_t(v)};
}

void place_points(SetupCache& setups, std::uint32_t page, std::uint32_t x, std::uint32_t y,
                  std::span<const Fragment> fragments, std::span<SamplePoint> points) {
  Point net[kPoints];
  scrambled_net(mix(std::uint64_t(page) << 32 | std::uint64_t(y) << 16 | x), net);
  double covered = 0;
  for (const Fragment& fragment : fragments) covered += fragment.area;
  if (covered > 1 - 1e-9) {
    place_in_square(setups, {double(x), double(y)}, fragments, net, points);
  } else {
    place_along_area(setups, x, y, fragments, net, points);
  }
}

}  // namespace kiln::atlas
