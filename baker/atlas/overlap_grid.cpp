#include "baker/atlas/overlap_grid.h"

namespace kiln::atlas {
namespace {

/// Samples lie off the cells' middle because edges of grid-aligned layouts often run there.
constexpr double kSampleX = 0.5173, kSampleY = 0.4871;
constexpr double kDeep = 0.5;  ///< cells

/// Returns the distance of `p` to the nearest edge, negative outside. Either winding will do.
double depth(const OverlapGrid::Triangle& t, Point p) {
  const double sign = cross(t[0], t[1], t[2]) < 0 ? -1 : 1;
  double least = INFINITY;
  for (std::size_t i = 0; i < 3; ++i) {
    const Point a = t[i], b = t[(i + 1) % 3];
    const double l = std::hypot(b.x - a.x, b.y - a.y);
    least = std::min(least, l > 0 ? sign * cross(a, b, p) / l : 0.0);
  }
  return least;
}

}  // namespace

void OverlapGrid::begin(std::uint32_t size) {
  base_ += std::uint32_t(triangles_.size());
  triangles_.clear();
  size_ = size;
  owner_.resize(std::max(owner_.size(), std::size_t(size) * size), 0);
  if (base_ > 0x7fffffffu) {  // the numbers could run out within the next layout
    std::fill(owner_.begin(), owner_.end(), 0);
    base_ = 0;
  }
}

/// Calls visit(cell, sample) until it returns false.
template <class Visit>
void OverlapGrid::for_samples(const Triangle& t, Visit&& visit) const {
  const double size = double(size_);
  Interval ys;
  for (const Point p : t) ys.add(p.y);
  const double sign = cross(t[0], t[1], t[2]) < 0 ? -1 : 1;
  const int y0 = int(std::clamp(std::floor(ys.min - kSampleY), 0.0, size));
  const int y1 = int(std::clamp(std::ceil(ys.max - kSampleY) + 1, 0.0, size));
  for (int y = y0; y < y1; ++y) {
    const double sy = y + kSampleY;
    double low = 0, high = size;
    for (std::size_t i = 0; i < 3; ++i) {  // each edge bounds x from one side
      const Point a = t[i], b = t[(i + 1) % 3];
      const double dx = (b.x - a.x) * sign, dy = (b.y - a.y) * sign;
      const double c = dx * (sy - a.y) + dy * a.x;  // inside: c - dy * x > 0
      if (dy > 0) high = std::min(high, c / dy);
      if (dy < 0) low = std::max(low, c / dy);
      if (dy == 0 && c <= 0) high = -1;
    }
    const int x0 = int(std::clamp(std::ceil(low - kSampleX), 0.0, size));
    const int x1 = int(std::clamp(std::ceil(high - kSampleX), 0.0, size));
    for (int x = x0; x < x1; ++x) {
      if (!visit(std::size_t(y) * size_ + std::size_t(x), Point{x + kSampleX, sy})) return;
    }
  }
}

OverlapGrid::Finding OverlapGrid::probe(const Triangle& triangle) const {
  Finding found;
  for_samples(triangle, [&](std::size_t cell, Point sample) {
    ++found.samples;
    if (owner_[cell] <= base_) return true;
    const std::uint32_t other = owner_[cell] - base_ - 1;
    if (depth(triangle, sample) >= kDeep && depth(triangles_[other], sample) >= kDeep) {
      found.deep_with = other;
      return false;
    }
    ++found.shallow;
    return true;
  });
  return found;
}

void OverlapGrid::add(const Triangle& triangle) {
  triangles_.push_back(triangle);
  const std::uint32_t mark = base_ + std::uint32_t(triangles_.size());
  for_samples(triangle, [&](std::size_t cell, Point) {
    if (owner_[cell] <= base_) owner_[cell] = mark;
    return true;
  });
}

}  // namespace kiln::atlas
