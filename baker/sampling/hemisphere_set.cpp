#include "baker/sampling/hemisphere_set.h"

#include <algorithm>
#include <cmath>

#include "baker/sampling/empty_circle.h"
#include "baker/sampling/estimate.h"

namespace kiln::sampling {
namespace {

std::uint32_t cells_of(std::uint32_t resolution) {
  return 3 * resolution * resolution;
}

std::uint32_t hemicube_resolution(std::uint32_t count) {
  std::uint32_t r = 2;
  while (std::max(cells_of(r + 2), count) - std::min(cells_of(r + 2), count) <
         std::max(cells_of(r), count) - std::min(cells_of(r), count))
    r += 2;
  return r;
}

}  // namespace

void HemisphereSet::add(math::Vec3 direction, float its_weight, float its_contrast) {
  x.push_back(direction.x), y.push_back(direction.y), z.push_back(direction.z);
  weight.push_back(its_weight), contrast.push_back(its_contrast);
}

float HemisphereSet::solid_angle(std::uint32_t i) const {
  constexpr float kGrazing = 0.01f;
  return math::kPi * weight[i] / std::max(kGrazing, z[i]);
}

HemisphereSet disc_directions(std::uint32_t count, std::uint64_t seed, DiscRule rule) {
  const std::vector<math::Vec2d> points = largest_empty_circle_points(count, seed);
  // Equal weights, or those of the cells of the first points of a range.
  const auto cells_of_range = [&](std::uint32_t begin, std::uint32_t end) {
    const std::vector<math::Vec2d> some(points.begin() + begin, points.begin() + end);
    if (rule == DiscRule::kCells) return voronoi_cells(some);
    std::vector<DiscCell> cells;
    for (const math::Vec2d p : some) cells.push_back({p, 1. / double(some.size())});
    return cells;
  };
  const std::uint32_t half = (count + 1) / 2;
  const std::vector<DiscCell> all = cells_of_range(0, count), first = cells_of_range(0, half),
                              second = cells_of_range(half, count);
  HemisphereSet set;
  for (std::uint32_t i = 0; i < count; ++i) {
    const math::Vec2d p = all[i].centroid;
    const double z = std::sqrt(std::max(0., 1 - dot(p, p)));
    const double in_half = i < half ? first[i].share : -second[i - half].share;
    set.add({float(p.x), float(p.y), float(z)}, float(all[i].share),
            float(in_half / 2) * kDiscCorrection);
  }
  return set;
}

HemisphereSet hemicube_directions(std::uint32_t count) {
  const std::uint32_t r = hemicube_resolution(count);
  struct Cell {
    math::Vec3 direction;
    double factor;
    bool second;
  };
  std::vector<Cell> cells;
  double sum = 0, halves[2] = {};
  // A cell of area ΔA at (x, y, 1) or (1, y, z), the normal along z.
  const auto cell = [&](double x, double y, double z, bool second) {
    const double square = x * x + y * y + z * z, l = std::sqrt(square);
    const double factor = z / (square * square);  // but for ΔA/π
    cells.push_back({{float(x / l), float(y / l), float(z / l)}, factor, second});
    sum += factor, halves[second] += factor;
  };
  const auto middle = [r](std::uint32_t i) { return (2 * i + 1.) / r - 1; };
  for (std::uint32_t j = 0; j < r; ++j)
    for (std::uint32_t i = 0; i < r; ++i) cell(middle(i), middle(j), 1, (i + j) % 2 != 0);
  for (std::uint32_t j = r / 2; j < r; ++j)
    for (std::uint32_t i = 0; i < r; ++i) {
      const bool second = (i + j) % 2 != 0;
      const double along = middle(i), up = middle(j);
      cell(1, along, up, second), cell(-along, 1, up, second);
      cell(-1, -along, up, second), cell(along, -1, up, second);
    }
  HemisphereSet set;
  for (const Cell& c : cells)
    set.add(c.direction, float(c.factor / sum),
            float((c.second ? -0.5 : 0.5) * c.factor / halves[c.second]) * kHemicubeCorrection);
  return set;
}

}  // namespace kiln::sampling
