#include "baker/generate/shapes.h"

#include <algorithm>
#include <cmath>
#include <memory>

namespace kiln::generate {
namespace {

struct SheetPoints {
  SheetCells cells;
  std::vector<math::Vec3> positions;

  const math::Vec3& at(std::uint32_t column, std::uint32_t row) const {
    return positions[row * (cells.columns + 1) + column];
  }
};

SheetPoints points_of(const SheetCells& cells, const SheetPoint& point) {
  SheetPoints sheet{cells, {}};
  for (std::uint32_t j = 0; j <= cells.rows; ++j)
    for (std::uint32_t i = 0; i <= cells.columns; ++i)
      sheet.positions.push_back(point(cells.closes_columns && i == cells.columns ? 0 : i,
                                      cells.closes_rows && j == cells.rows ? 0 : j));
  return sheet;
}

/// Returns the normals of all points: the mean of the cells around a point.
std::vector<math::Vec3> mean_normals(const SheetPoints& sheet) {
  const SheetCells& cells = sheet.cells;
  std::vector<math::Vec3> normals(sheet.positions.size());
  const auto add = [&](std::uint32_t i, std::uint32_t j, math::Vec3 n) {
    const auto both = [&](std::uint32_t column, std::uint32_t row) {
      normals[row * (cells.columns + 1) + column] += n;
      if (cells.closes_rows && (row == 0 || row == cells.rows))
        normals[(cells.rows - row) * (cells.columns + 1) + column] += n;
    };
    both(i, j);
    if (cells.closes_columns && (i == 0 || i == cells.columns)) both(cells.columns - i, j);
  };
  for (std::uint32_t j = 0; j < cells.rows; ++j)
    for (std::uint32_t i = 0; i < cells.columns; ++i) {
      const math::Vec3 n =
          cross(sheet.at(i + 1, j + 1) - sheet.at(i, j), sheet.at(i, j + 1) - sheet.at(i + 1, j));
      add(i, j, n), add(i + 1, j, n), add(i + 1, j + 1, n), add(i, j + 1, n);
    }
  for (math::Vec3& n : normals) n = math::normalize(n);
  return normals;
}

float mean_width(const SheetPoints& sheet) {
  float sum = 0;
  for (std::uint32_t j = 0; j <= sheet.cells.rows; ++j)
    for (std::uint32_t i = 0; i < sheet.cells.columns; ++i)
      sum += length(sheet.at(i + 1, j) - sheet.at(i, j));
  return sum / float(sheet.cells.rows + 1);
}

float mean_height(const SheetPoints& sheet) {
  float sum = 0;
  for (std::uint32_t i = 0; i <= sheet.cells.columns; ++i)
    for (std::uint32_t j = 0; j < sheet.cells.rows; ++j)
      sum += length(sheet.at(i, j + 1) - sheet.at(i, j));
  return sum / float(sheet.cells.columns + 1);
}

math::Vec3 in_frame(const Frame& f, math::Vec3 p) {
  return f.x * p.x + f.y * p.y + f.z * p.z;
}

}  // namespace

math::Vec2 on_circle(double turns) {
  const double turn = turns - std::floor(turns);
  const double eighths = turn * 8;
  const int octant = std::min(7, static_cast<int>(eighths));
  // The angle to the nearest multiple of a quarter turn, in [0, 1/8]: odd octants run backwards.
  const double part = octant % 2 == 0 ? eighths - octant : octant + 1 - eighths;
  const double a = part * 0.78539816339744830962, b = a * a;
  const double sine =
      a * (1 + b * (-1. / 6 + b * (1. / 120 + b * (-1. / 5040 + b * (1. / 362880)))));
  const double cosine =
      1 + b * (-1. / 2 + b * (1. / 24 + b * (-1. / 720 + b * (1. / 40320 - b / 3628800))));
  const auto s = static_cast<float>(sine), c = static_cast<float>(cosine);
  const math::Vec2 of_octant[8] = {{c, s},   {s, c},   {-s, c}, {-c, s},
                                   {-c, -s}, {-s, -c}, {s, -c}, {c, -s}};
  return of_octant[octant];
}

math::Vec3 around_y(double turns) {
  const math::Vec2 p = on_circle(turns);
  return {p.x, 0, -p.y};
}

void add_sheet(SceneBuilder& scene, const Part& part, const SheetCells& cells,
               const SheetPoint& point, const SheetPoint& normal) {
  auto sheet = std::make_shared<const SheetPoints>(points_of(cells, point));
  auto normals = std::make_shared<const std::vector<math::Vec3>>(
      normal ? points_of(cells, normal).positions : mean_normals(*sheet));
  const float width_m = part.density * mean_width(*sheet);
  const float height_m = part.density * mean_height(*sheet);
  scene.surface(
      {part.node, part.material, width_m, height_m, cells.columns, cells.rows, false,
       [sheet, normals](std::uint32_t i, std::uint32_t j) {
         return SurfacePoint{sheet->at(i, j), (*normals)[j * (sheet->cells.columns + 1) + i]};
       }});
}

void add_corners(SceneBuilder& scene, const Part& part, math::Vec3 a, math::Vec3 b, math::Vec3 c,
                 math::Vec3 d) {
  add_sheet(scene, part, {1, 1}, [&](std::uint32_t i, std::uint32_t j) {
    return j == 0 ? (i == 0 ? a : b) : (i == 0 ? d : c);
  });
}

void add_triangle(SceneBuilder& scene, const Part& part, math::Vec3 a, math::Vec3 b, math::Vec3 c) {
  const math::Vec3 normal = math::normalize(cross(b - a, c - a));
  scene.surface({part.node, part.material, length(b - a), length(c - a), 1, 1, true,
                 [=](std::uint32_t i, std::uint32_t j) {
                   return SurfacePoint{j == 1 ? c : i == 1 ? b : a, normal};
                 }});
}

void add_box(SceneBuilder& scene, const Part& part, const Box& box, unsigned faces) {
  const math::Vec3 axis_z = cross(box.axis_x, {0, 1, 0});
  const auto corner = [&](math::Vec3 unit) {
    return box.bottom + box.axis_x * (unit.x * box.size.x / 2) +
           math::Vec3{0, (unit.y + 1) / 2 * box.size.y, 0} + axis_z * (unit.z * box.size.z / 2);
  };
  for (const CubeFace& f : kCube)
    if ((faces & f.face) != 0)
      add_corners(scene, part, corner(f.center - f.edge_u - f.edge_v),
                  corner(f.center + f.edge_u - f.edge_v), corner(f.center + f.edge_u + f.edge_v),
                  corner(f.center - f.edge_u + f.edge_v));
}

void add_fan(SceneBuilder& scene, const Part& part, const std::vector<math::Vec3>& ring,
             math::Vec3 middle) {
  const auto n = static_cast<std::uint32_t>(ring.size() / 4);
  add_sheet(scene, part, {n, n}, [&](std::uint32_t i, std::uint32_t j) {
    // Squares around the chart's middle become rings around `middle`. All numbers are whole
    // multiples of 1/2n up to the quotient, so points on the border are those of the ring.
    const int half = static_cast<int>(n), u = 2 * static_cast<int>(i) - half,
              v = 2 * static_cast<int>(j) - half;
    const int size = std::max(std::abs(u), std::abs(v));
    if (size == 0) return middle;
    int along = 0, side = 0;  // along the side, 0 to 2 size
    if (v == -size && u < size)
      along = u + size;
    else if (u == size && v < size)
      along = v + size, side = 1;
    else if (v == size && u > -size)
      along = size - u, side = 2;
    else
      along = size - v, side = 3;
    const int numerator = along * half, whole = numerator / (2 * size);
    const float fraction = float(numerator % (2 * size)) / float(2 * size);
    const std::size_t k = std::size_t(side) * n + std::size_t(whole);
    const math::Vec3 from = ring[k % ring.size()], to = ring[(k + 1) % ring.size()];
    const math::Vec3 border = fraction == 0 ? from : from + (to - from) * fraction;
    if (size == half) return border;
    return middle + (border - middle) * (float(size) / float(half));
  });
}

void add_turned_lathe(SceneBuilder& scene, const Part& part, math::Vec3 foot, const Frame& frame,
                      const std::vector<LatheRing>& rings, std::uint32_t segments, Ends ends) {
  const auto at = [&](std::uint32_t segment, const LatheRing& ring) {
    math::Vec3 p = around_y(double(segment) / double(segments)) * ring.radius;
    p.y = ring.height;
    return foot + in_frame(frame, p);
  };
  const auto rows = static_cast<std::uint32_t>(rings.size()) - 1;
  add_sheet(scene, part, {segments, rows, true},
            [&](std::uint32_t i, std::uint32_t j) { return at(i, rings[j]); });
  const auto add_end = [&](const LatheRing& ring, bool upwards) {
    std::vector<math::Vec3> points;
    for (std::uint32_t i = 0; i < segments; ++i)
      points.push_back(at(upwards ? i : (segments - i) % segments, ring));
    add_fan(scene, part, points, foot + frame.y * ring.height);
  };
  if (ends != Ends::kOpen) add_end(rings.back(), true);
  if (ends == Ends::kBoth) add_end(rings.front(), false);
}

void add_lathe(SceneBuilder& scene, const Part& part, math::Vec3 foot,
               const std::vector<LatheRing>& rings, std::uint32_t segments, Ends ends) {
  add_turned_lathe(scene, part, foot, {}, rings, segments, ends);
}

void add_torus(SceneBuilder& scene, const Part& part, math::Vec3 center, const Frame& frame,
               float radius, float section_radius, std::uint32_t segments,
               std::uint32_t section_segments) {
  add_sheet(scene, part, {segments, section_segments, true, true},
            [&](std::uint32_t i, std::uint32_t j) {
              const math::Vec3 outwards = around_y(double(i) / double(segments));
              const math::Vec2 section = on_circle(double(j) / double(section_segments));
              math::Vec3 p = outwards * (radius + section_radius * section.x);
              p.y = section_radius * section.y;
              return center + in_frame(frame, p);
            });
}

void add_ellipsoid(SceneBuilder& scene, const Part& part, math::Vec3 center, math::Vec3 radii,
                   const CubeCells& cells) {
  const auto cells_along = [&](math::Vec3 edge) {
    return edge.x != 0 ? cells.x : edge.y != 0 ? cells.y : cells.z;
  };
  const auto share = [](std::uint32_t i, std::uint32_t n) {
    return (2 * float(i) - float(n)) / float(n);
  };
  for (const CubeFace& f : kCube) {
    const std::uint32_t columns = cells_along(f.edge_u), rows = cells_along(f.edge_v);
    const auto direction = [&](std::uint32_t i, std::uint32_t j) {
      return math::normalize(f.center + f.edge_u * share(i, columns) + f.edge_v * share(j, rows));
    };
    const SheetPoint position = [&](std::uint32_t i, std::uint32_t j) {
      const math::Vec3 d = direction(i, j);
      return center + math::Vec3{d.x * radii.x, d.y * radii.y, d.z * radii.z};
    };
    const SheetPoint normal = [&](std::uint32_t i, std::uint32_t j) {
      const math::Vec3 d = direction(i, j);
      return math::normalize({d.x / radii.x, d.y / radii.y, d.z / radii.z});
    };
    add_sheet(scene, part, {columns, rows}, position, normal);
  }
}

void add_pyramid(SceneBuilder& scene, const Part& part, math::Vec3 bottom, math::Vec3 size,
                 math::Vec3 axis_x, bool closed) {
  const math::Vec3 x = axis_x * (size.x / 2), z = cross(axis_x, {0, 1, 0}) * (size.z / 2);
  const math::Vec3 top = bottom + math::Vec3{0, size.y, 0};
  const math::Vec3 corners[4] = {bottom - x + z, bottom + x + z, bottom + x - z, bottom - x - z};
  for (int i = 0; i < 4; ++i) add_triangle(scene, part, corners[i], corners[(i + 1) % 4], top);
  if (closed) add_corners(scene, part, corners[3], corners[2], corners[1], corners[0]);
}

}  // namespace kiln::generate
