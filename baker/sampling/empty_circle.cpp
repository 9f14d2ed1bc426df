#include "baker/sampling/empty_circle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "baker/sampling/sobol.h"

namespace kiln::sampling {
namespace {

using math::Vec2d;

constexpr std::uint32_t kRandomPoints = 4;

/// The triangulation by Delaunay of points of the unit disc, kept up as points come [Bowyer 1981,
/// Watson 1981], with the largest circle about a point of the disc that holds none of them.
///
/// Three corners far outside of the disc hold all in one triangle. Every point of the disc is
/// nearer to a point of the set than to these, so within the disc the Voronoi diagram is that of
/// the set alone.
class Triangulation {
 public:
  Triangulation() {
    constexpr double kFar = 64;  // radii of the disc
    for (int k = 0; k < 3; ++k) {
      const double angle = 2 * std::numbers::pi * k / 3 + 0.1;
      points_.push_back(Vec2d{std::cos(angle), std::sin(angle)} * kFar);
    }
    triangles_.push_back({{0, 1, 2}, {-1, -1, -1}});
    gaps_.emplace_back();
    place(0);
  }

  void add(Vec2d p) {
    points_.push_back(p);
    find_cavity(p);
    fill_cavity(int(points_.size()) - 1);
  }

  /// Returns the center of the largest empty circle.
  Vec2d largest() const {
    std::size_t best = 0;
    for (std::size_t t = 1; t < gaps_.size(); ++t)
      if (gaps_[t].radius2 > gaps_[best].radius2) best = t;
    return gaps_[best].center;
  }

  /// Returns the corners of the Voronoi cells of all points, counter-clockwise.
  std::vector<std::vector<Vec2d>> cells() const {
    std::vector<std::vector<Vec2d>> all(points_.size() - kCorners);
    for (std::size_t t = 0; t < triangles_.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k) {
        const int point = triangles_[t].corner[k];
        if (point < kCorners || !all[std::size_t(point - kCorners)].empty()) continue;
        walk_around(int(t), point, all[std::size_t(point - kCorners)]);
      }
    return all;
  }

 private:
  static constexpr int kCorners = 3;

  struct Triangle {
    std::array<int, 3> corner;    ///< counter-clockwise
    std::array<int, 3> neighbor;  ///< across from the corner; -1: none
    Vec2d center{};               ///< of the circle around it
    double radius2 = 0;
    bool in_cavity = false;
  };
  /// A circle without a point in it.
  struct Gap {
    Vec2d center;
    double radius2 = -1;
  };
  struct Edge {
    int from = 0, to = 0;  ///< counter-clockwise around the cavity
    int outside = -1;      ///< the triangle beyond
  };

  static double twice_area(Vec2d a, Vec2d b, Vec2d c) { return cross(b - a, c - a); }

  /// Lists the centers of the triangles around a point, from one of them on.
  void walk_around(int start, int point, std::vector<Vec2d>& centers) const {
    int t = start;
    do {
      const Triangle& it = triangles_[std::size_t(t)];
      centers.push_back(it.center);
      std::size_t k = 0;
      while (it.corner[k] != point) ++k;
      t = it.neighbor[(k + 1) % 3];
    } while (t != start);
  }

  bool is_around(const Triangle& t, Vec2d p) const {
    const Vec2d d = p - t.center;
    return dot(d, d) < t.radius2;
  }

  /// Computes the circle around a triangle.
  void place(int t) {
    Triangle& it = triangles_[std::size_t(t)];
    const Vec2d a = points_[std::size_t(it.corner[0])];
    const Vec2d b = points_[std::size_t(it.corner[1])] - a,
                c = points_[std::size_t(it.corner[2])] - a;
    const double d = 2 * cross(b, c), bb = dot(b, b), cc = dot(c, c);
    const Vec2d from_a{(c.y * bb - b.y * cc) / d, (b.x * cc - c.x * bb) / d};
    it.center = a + from_a;
    it.radius2 = dot(from_a, from_a);
  }

  /// Finds the triangles whose circles hold the point.
  void find_cavity(Vec2d p) {
    cavity_.clear();
    for (std::size_t t = 0; t < triangles_.size() && cavity_.empty(); ++t)
      if (is_around(triangles_[t], p)) take(int(t));
    for (std::size_t i = 0; i < cavity_.size(); ++i)
      for (const int n : triangles_[std::size_t(cavity_[i])].neighbor)
        if (n >= 0 && !triangles_[std::size_t(n)].in_cavity &&
            is_around(triangles_[std::size_t(n)], p))
          take(n);
    // Rounding may leave an edge that the point does not see, of four points on one circle.
    while (!find_rim(p)) {
    }
  }
  void take(int t) {
    triangles_[std::size_t(t)].in_cavity = true;
    cavity_.push_back(t);
  }

  /// Lists the edges of the cavity. Where the point does not see one, takes what lies beyond into
  /// the cavity and returns false.
  bool find_rim(Vec2d p) {
    rim_.clear();
    for (const int t : cavity_) {
      const Triangle& it = triangles_[std::size_t(t)];
      for (std::size_t k = 0; k < 3; ++k) {
        const int n = it.neighbor[k];
        if (n >= 0 && triangles_[std::size_t(n)].in_cavity) continue;
        const Edge e{it.corner[(k + 1) % 3], it.corner[(k + 2) % 3], n};
        const double seen = twice_area(p, points_[std::size_t(e.from)], points_[std::size_t(e.to)]);
        if (!(seen > 0) && n >= 0) return take(n), false;
        rim_.push_back(e);
      }
    }
    return true;
  }

  /// Puts triangles between the point and the edges of the cavity, in place of those that were
  /// there and of two more.
  void fill_cavity(int point) {
    while (cavity_.size() < rim_.size()) {
      cavity_.push_back(int(triangles_.size()));
      triangles_.emplace_back();
      gaps_.emplace_back();
    }
    for (std::size_t i = 0; i < rim_.size(); ++i) {
      const Edge& e = rim_[i];
      const auto next = [&](int from, int Edge::*end) {
        for (std::size_t k = 0; k < rim_.size(); ++k)
          if (rim_[k].*end == from) return cavity_[k];
        return -1;
      };
      Triangle& t = triangles_[std::size_t(cavity_[i])];
      t = {{point, e.from, e.to}, {e.outside, next(e.to, &Edge::from), next(e.from, &Edge::to)}};
      if (e.outside >= 0) {
        Triangle& beyond = triangles_[std::size_t(e.outside)];
        for (std::size_t k = 0; k < 3; ++k)
          if (beyond.corner[(k + 1) % 3] == e.to && beyond.corner[(k + 2) % 3] == e.from)
            beyond.neighbor[k] = cavity_[i];
      }
      place(cavity_[i]);
    }
    for (std::size_t i = 0; i < rim_.size(); ++i) {
      measure(cavity_[i]);
      if (rim_[i].outside >= 0) measure(rim_[i].outside);
    }
  }

  /// Finds the largest empty circle about a point of the disc that a triangle has: about the center
  /// of its own circle, or where a Voronoi edge to one of its neighbors leaves the disc.
  void measure(int t) {
    const Triangle& it = triangles_[std::size_t(t)];
    Gap& gap = gaps_[std::size_t(t)];
    gap = {};
    if (dot(it.center, it.center) <= 1) gap = {it.center, it.radius2};
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = it.corner[(k + 1) % 3], b = it.corner[(k + 2) % 3], n = it.neighbor[k];
      if (n < 0 || a < kCorners || b < kCorners) continue;
      const Vec2d from = it.center, way = triangles_[std::size_t(n)].center - from;
      const double ww = dot(way, way), fw = dot(from, way);
      const double under = fw * fw - ww * (dot(from, from) - 1);
      if (!(under >= 0 && ww > 0)) continue;
      for (const double side : {-1., 1.}) {
        const double s = (-fw + side * std::sqrt(under)) / ww;
        if (!(s >= 0 && s <= 1)) continue;
        const Vec2d at = from + way * s, d = at - points_[std::size_t(a)];
        if (dot(d, d) > gap.radius2) gap = {at * (1 / length(at)), dot(d, d)};
      }
    }
  }

  std::vector<Vec2d> points_;  ///< the far corners first
  std::vector<Triangle> triangles_;
  std::vector<Gap> gaps_;  ///< of each triangle
  std::vector<int> cavity_;
  std::vector<Edge> rim_;
};

/// Appends the inner points of the arc of the unit circle that leads from one point to another.
void add_arc(Vec2d from, Vec2d to, std::vector<Vec2d>& line) {
  constexpr int kPieces = 32;
  const double start = std::atan2(from.y, from.x);
  double angle = std::atan2(to.y, to.x) - start;
  if (angle < 0) angle += 2 * std::numbers::pi;
  for (int i = 1; i < kPieces; ++i) {
    const double a = start + angle * i / kPieces;
    line.push_back({std::cos(a), std::sin(a)});
  }
}

/// Returns the part of a convex polygon that lies in the unit disc, with arcs in short pieces; the
/// polygon holds a point of the disc.
std::vector<Vec2d> in_disc(const std::vector<Vec2d>& polygon) {
  std::vector<Vec2d> line;
  bool has_left = false;  // at the last of the line
  Vec2d first_entry{};
  bool enters_first = false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2d from = polygon[i], way = polygon[(i + 1) % polygon.size()] - from;
    if (dot(from, from) <= 1) line.push_back(from);
    const double ww = dot(way, way), fw = dot(from, way);
    const double under = fw * fw - ww * (dot(from, from) - 1);
    if (!(under > 0 && ww > 0)) continue;
    for (const bool leaves : {false, true}) {
      const double s = (-fw + (leaves ? 1 : -1) * std::sqrt(under)) / ww;
      if (!(s > 0 && s < 1)) continue;
      const Vec2d at = from + way * s;
      if (!leaves && has_left) add_arc(line.back(), at, line);
      if (!leaves && line.empty()) first_entry = at, enters_first = true;
      line.push_back(at);
      has_left = leaves;
    }
  }
  if (has_left && enters_first) add_arc(line.back(), first_entry, line);
  if (line.empty()) add_arc({1, 0}, {1, -1e-9}, line);
  return line;
}

/// Measures a polygon; the share is its area.
DiscCell measure(const std::vector<Vec2d>& line) {
  const auto next = [&](std::size_t i) { return line[(i + 1) % line.size()]; };
  DiscCell cell;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const double area = cross(line[i], next(i)) / 2;
    cell.share += area;
    cell.centroid = cell.centroid + (line[i] + next(i)) * (area / 3);
  }
  cell.centroid = cell.centroid * (1 / cell.share);
  return cell;
}

Vec2d random_point(std::uint32_t i, std::uint64_t seed) {
  const std::uint32_t key = hash(std::uint32_t(seed), std::uint32_t(seed >> 32), i);
  const double r = std::sqrt(double(hash(key, 1)) * 0x1p-32);
  const double angle = 2 * std::numbers::pi * double(hash(key, 2)) * 0x1p-32;
  return {r * std::cos(angle), r * std::sin(angle)};
}

}  // namespace

std::vector<Vec2d> largest_empty_circle_points(std::uint32_t count, std::uint64_t seed) {
  Triangulation circles;
  std::vector<Vec2d> points;
  points.reserve(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    points.push_back(i < kRandomPoints ? random_point(i, seed) : circles.largest());
    circles.add(points.back());
  }
  return points;
}

std::vector<DiscCell> voronoi_cells(const std::vector<Vec2d>& points) {
  Triangulation triangles;
  for (const Vec2d p : points) triangles.add(p);
  std::vector<DiscCell> cells;
  double all = 0;
  for (const std::vector<Vec2d>& polygon : triangles.cells()) {
    cells.push_back(measure(in_disc(polygon)));
    all += cells.back().share;
  }
  for (DiscCell& cell : cells) cell.share /= all;
  return cells;
}

}  // namespace kiln::sampling
