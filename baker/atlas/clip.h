#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "baker/atlas/atlas.h"

namespace kiln::atlas {

/// A point on a page, in texels. It is in double precision because a texel square is often 1e-4 of
/// the page, and the fragments of a triangle must sum to the whole.
using Point = math::Vec2d;
inline double cross(Point a, Point b, Point c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// A convex polygon that remains of a triangle after at most four cuts by axis-parallel lines.
struct Polygon {
  static constexpr int kMaxVertices = 8;
  Point v[kMaxVertices];
  int n = 0;

  /// Geometry allows at most seven vertices. An eighth one repeats another by a rounding error.
  void add(Point p) {
    if (n < kMaxVertices) v[n++] = p;
  }
  /// Returns the unsigned area, texels^2. It is measured from the first vertex, so that small
  /// polygons far from the origin keep their digits.
  double area() const {
    double twice = 0;
    for (int i = 1; i + 1 < n; ++i) twice += cross(v[0], v[i], v[i + 1]);
    return std::abs(twice) / 2;
  }
};

enum class Axis { kX, kY };
template <Axis A>
double along(Point p) {
  return A == Axis::kX ? p.x : p.y;
}

/// Cuts `in` along the line axis = c. `low` gets the part below, `high` the part above [Sutherland
/// and Hodgman 1974]. New vertices lie on the line exactly.
template <Axis A>
void split(const Polygon& in, double c, Polygon& low, Polygon& high) {
  low.n = high.n = 0;
  for (int i = 0; i < in.n; ++i) {
    const Point p = in.v[i], q = in.v[i + 1 < in.n ? i + 1 : 0];
    const double dp = along<A>(p) - c, dq = along<A>(q) - c;
    if (dp <= 0) low.add(p);
    if (dp >= 0) high.add(p);
    if ((dp < 0 && dq > 0) || (dp > 0 && dq < 0)) {
      const double t = dp / (dp - dq);
      Point r{p.x + (q.x - p.x) * t, p.y + (q.y - p.y) * t};
      (A == Axis::kX ? r.x : r.y) = c;
      low.add(r);
      high.add(r);
    }
  }
}

struct Interval {
  double min = INFINITY, max = -INFINITY;
  void add(double v) { min = std::min(min, v), max = std::max(max, v); }
};
template <Axis A>
Interval extent(const Polygon& p) {
  Interval e;
  for (int i = 0; i < p.n; ++i) e.add(along<A>(p.v[i]));
  return e;
}

/// A triangle on its page.
struct UvTriangle {
  Point p[3];
  double det = 0;  ///< twice the signed area, texels^2

  UvTriangle(const Atlas& atlas, std::uint32_t triangle) {
    for (int i = 0; i < 3; ++i) {
      const math::Vec2 uv = atlas.vertices[atlas.triangles[triangle][i]].uv;
      p[i] = {uv.x, uv.y};
    }
    det = cross(p[0], p[1], p[2]);
  }
  double area() const { return std::abs(det) / 2; }
  Polygon polygon() const { return {{p[0], p[1], p[2]}, 3}; }
};

/// A triangle with less area on the page (texels^2) counts as having none: so small an area is
/// within the rounding of float coordinates.
inline constexpr double kMinUvArea = 1e-9;

/// The part of one texel that one triangle covers.
struct Fragment {
  std::uint32_t key = 0;  ///< the texel's place in its band: block, then row, then column
  std::uint32_t triangle = 0;
  double area = 0;  ///< texels^2
};

/// Returns the part of a polygon inside the square of texel (x, y).
inline Polygon clip_to_texel(const Polygon& polygon, std::uint32_t x, std::uint32_t y) {
  Polygon a, b, unused;
  split<Axis::kX>(polygon, double(x), unused, a);
  split<Axis::kX>(a, double(x) + 1, b, unused);
  split<Axis::kY>(b, double(y), unused, a);
  split<Axis::kY>(a, double(y) + 1, b, unused);
  return b;
}

namespace clip_impl {

/// Cuts a strip of one row into texels [x0, x1) from left to right.
template <class Emit>
void walk(Polygon strip, int x0, int x1, int y, Emit& emit) {
  Polygon texel, rest;
  for (int x = x0; x < x1 && strip.n >= 3; ++x) {
    split<Axis::kX>(strip, double(x) + 1, texel, rest);
    if (const double a = texel.area(); a > 0) emit(x, y, a);
    std::swap(strip, rest);
  }
}

/// Returns the columns that lie in the strip over the row's whole height. The strip is convex, so
/// its sides are innermost on the row's upper or lower line.
inline Interval full_columns(const Polygon& strip, double y) {
  Interval top, bottom;
  for (int i = 0; i < strip.n; ++i) {
    if (strip.v[i].y == y) top.add(strip.v[i].x);
    if (strip.v[i].y == y + 1) bottom.add(strip.v[i].x);
  }
  return {std::ceil(std::max(top.min, bottom.min)), std::floor(std::min(top.max, bottom.max))};
}

}  // namespace clip_impl

/// Calls emit(x, y, area) for each texel of rows [y0, y1) and columns [0, width) that `polygon`
/// covers in part. The area is in (0, 1], exactly 1 where the square is covered.
template <class Emit>
void for_texels(const Polygon& polygon, int y0, int y1, int width, Emit&& emit) {
  Polygon rest, strip, part, unused;
  split<Axis::kY>(polygon, double(y0), unused, rest);
  const Interval ys = extent<Axis::kY>(rest);
  if (rest.n < 3) return;
  const int first = int(std::clamp(std::floor(ys.min), double(y0), double(y1)));
  const int last = int(std::clamp(std::ceil(ys.max), double(y0), double(y1)));
  for (int y = first; y < last && rest.n >= 3; ++y) {
    split<Axis::kY>(rest, double(y) + 1, strip, part);
    std::swap(rest, part);
    if (strip.n < 3) continue;
    const Interval xs = extent<Axis::kX>(strip);
    const int x0 = int(std::clamp(std::floor(xs.min), 0.0, double(width)));
    const int x1 = int(std::clamp(std::ceil(xs.max), 0.0, double(width)));
    if (xs.min < x0) split<Axis::kX>(strip, double(x0), unused, part), std::swap(strip, part);
    const Interval full = clip_impl::full_columns(strip, double(y));
    const bool inner = full.min + 1 < full.max && full.min >= x0 && full.max <= x1;
    if (!inner) {
      clip_impl::walk(strip, x0, x1, y, emit);
      continue;
    }
    Polygon left, right;
    split<Axis::kX>(strip, full.min, left, right);
    clip_impl::walk(left, x0, int(full.min), y, emit);
    for (int x = int(full.min); x < int(full.max); ++x) emit(x, y, 1.0);
    split<Axis::kX>(right, full.max, unused, part);
    clip_impl::walk(part, int(full.max), x1, y, emit);
  }
}

}  // namespace kiln::atlas
