#include "baker/atlas/flatten.h"

#include <vector>

#include "baker/exec/stop.h"

namespace kiln::atlas {
namespace {

/// Returns the convex hull, counter-clockwise, without repeating the first point [Andrew 1979]. The
/// hull is empty when stopped.
std::vector<Point> convex_hull(std::vector<Point> p, const std::stop_token& stop) {
  const auto before = [](Point a, Point b) { return a.x != b.x ? a.x < b.x : a.y < b.y; };
  const auto same = [](Point a, Point b) { return a.x == b.x && a.y == b.y; };
  if (!exec::sort_unless_stopped(p, before, stop)) return {};
  p.erase(std::unique(p.begin(), p.end(), same), p.end());
  if (p.size() < 3) return p;
  std::vector<Point> hull;
  for (int pass = 0; pass < 2; ++pass) {  // lower chain, then upper
    const std::size_t start = hull.size();
    for (const Point q : p) {
      while (hull.size() >= start + 2 && cross(hull[hull.size() - 2], hull.back(), q) <= 0) {
        hull.pop_back();
      }
      hull.push_back(q);
    }
    hull.pop_back();  // it begins the other chain
    std::reverse(p.begin(), p.end());
  }
  return hull;
}

struct Box {
  double cosine = 1, sine = 0;
  Interval x, y;
  double width() const { return x.max - x.min; }
  double height() const { return y.max - y.min; }
};

Box box_along(std::span<const Point> hull, double dx, double dy) {
  const double l = std::hypot(dx, dy);
  Box box{l > 0 ? dx / l : 1, l > 0 ? dy / l : 0, {}, {}};
  for (const Point p : hull) {
    box.x.add(p.x * box.cosine + p.y * box.sine);
    box.y.add(p.y * box.cosine - p.x * box.sine);
  }
  return box;
}

Box smallest_box(std::span<const Point> hull) {
  Box best = box_along(hull, 1, 0);
  const std::size_t step = hull.size() / 64 + 1;
  for (std::size_t i = 0; i < hull.size(); i += step) {
    const Point a = hull[i], b = hull[(i + 1) % hull.size()];
    const Box box = box_along(hull, b.x - a.x, b.y - a.y);
    // The first of equal boxes wins, also when they differ by rounding.
    if (box.width() * box.height() < best.width() * best.height() * (1 - 1e-9)) best = box;
  }
  return best;
}

}  // namespace

math::Vec3d normal_of(math::Vec3 a, math::Vec3 b, math::Vec3 c) {
  const math::Vec3d origin = math::to_double(a);
  return cross(math::to_double(b) - origin, math::to_double(c) - origin);
}

math::Vec3d mean_normal(std::span<const std::uint32_t> faces, std::span<const math::Vec3d> normal,
                        std::span<const double> area) {
  math::Vec3d sum;
  for (const std::uint32_t face : faces) sum += normal[face] * area[face];
  return unit(sum);
}

ChartFrame smallest_frame(std::span<const math::Vec3> points, const math::Vec3d& axis,
                          const std::stop_token& stop) {
  // The world axis that is least along the normal gives the first direction.
  const double ax = std::abs(axis.x), ay = std::abs(axis.y), az = std::abs(axis.z);
  const math::Vec3d helper = ax <= ay && ax <= az ? math::Vec3d{1, 0, 0}
                             : ay <= az           ? math::Vec3d{0, 1, 0}
                                                  : math::Vec3d{0, 0, 1};
  ChartFrame frame;
  frame.origin = math::to_double(points[0]);
  frame.u = unit(cross(helper, axis));
  frame.v = cross(axis, frame.u);
  std::vector<Point> flat;
  flat.reserve(points.size());
  for (const math::Vec3 p : points) flat.push_back(frame.project(p));
  const auto hull = convex_hull(std::move(flat), stop);
  if (hull.empty()) return frame;
  Box box = smallest_box(hull);
  if (box.width() < box.height()) box = box_along(hull, -box.sine, box.cosine);
  const math::Vec3d u = frame.u, v = frame.v;
  frame.u = u * box.cosine + v * box.sine;
  frame.v = v * box.cosine - u * box.sine;
  frame.origin = frame.origin + frame.u * box.x.min + frame.v * box.y.min;
  frame.width = box.width();
  frame.height = box.height();
  return frame;
}

}  // namespace kiln::atlas
