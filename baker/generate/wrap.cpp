#include "baker/generate/wrap.h"

#include <algorithm>
#include <map>
#include <memory>
#include <set>

namespace kiln::generate {
namespace {

using Lattice = std::array<int, 3>;

/// A rectangle of cube sides in one plane of the lattice. d/d column x d/d row points outwards.
struct CageSide {
  Lattice corner, along_column, along_row;
  int columns = 0, rows = 0;  ///< cubes
};

Lattice operator+(Lattice a, Lattice b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
Lattice operator*(Lattice a, int s) {
  return {a[0] * s, a[1] * s, a[2] * s};
}

std::set<Lattice> cubes_of(const Cage& cage) {
  std::set<Lattice> cubes;
  for (const CageBox& box : cage.boxes)
    for (int z = box.low[2]; z < box.high[2]; ++z)
      for (int y = box.low[1]; y < box.high[1]; ++y)
        for (int x = box.low[0]; x < box.high[0]; ++x) cubes.insert({x, y, z});
  return cubes;
}

/// Takes the largest block of `free` that starts at its first member and grows along the column
/// before the row. Members are (row, column).
CageSide take_block(std::set<std::array<int, 2>>& free) {
  const auto [row, column] = *free.begin();
  CageSide side;
  while (free.count({row, column + side.columns}) != 0) ++side.columns;
  const auto whole_row = [&](int r) {
    for (int c = 0; c < side.columns; ++c)
      if (free.count({r, column + c}) == 0) return false;
    return true;
  };
  while (whole_row(row + side.rows)) ++side.rows;
  for (int r = 0; r < side.rows; ++r)
    for (int c = 0; c < side.columns; ++c) free.erase({row + r, column + c});
  side.corner = {row, column, 0};
  return side;
}

/// Returns the cage's surface in rectangles: for each direction and plane, from the lowest side on.
std::vector<CageSide> sides_of(const Cage& cage) {
  const std::set<Lattice> cubes = cubes_of(cage);
  std::vector<CageSide> sides;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const int sign : {-1, 1}) {
      Lattice out{}, u{}, v{};  // out = u x v
      out[axis] = sign;
      const std::size_t iu = sign > 0 ? (axis + 1) % 3 : (axis + 2) % 3, iv = 3 - axis - iu;
      u[iu] = v[iv] = 1;
      std::map<int, std::set<std::array<int, 2>>> planes;
      for (const Lattice& cube : cubes)
        if (cubes.count(cube + out) == 0)
          planes[cube[axis] + (sign > 0 ? 1 : 0)].insert({cube[iv], cube[iu]});
      for (auto& [plane, free] : planes)
        while (!free.empty()) {
          CageSide side = take_block(free);
          Lattice corner{};
          corner[axis] = plane, corner[iv] = side.corner[0], corner[iu] = side.corner[1];
          sides.push_back({corner, u, v, side.columns, side.rows});
        }
    }
  return sides;
}

/// The closed mesh at `cells` cells a cube: vertices that all sides share.
struct Mesh {
  std::uint32_t cells = 1;
  std::vector<math::Vec3> positions;
  std::vector<std::vector<std::uint32_t>> sides;  ///< vertices, row by row, parallel to the cage's
  std::vector<std::array<std::uint32_t, 4>> quads;
  std::vector<std::uint32_t> first_neighbor, neighbors;
};

int columns_of(const CageSide& side, std::uint32_t cells) {
  return side.columns * int(cells) + 1;
}

void add_neighbors(Mesh& mesh) {
  std::vector<std::array<std::uint32_t, 2>> edges;
  for (const auto& q : mesh.quads)
    for (std::size_t k = 0; k < 4; ++k) {
      // Each edge belongs to two faces that run along it in opposite directions.
      edges.push_back({q[k], q[(k + 1) % 4]});
    }
  std::sort(edges.begin(), edges.end());
  mesh.first_neighbor.assign(mesh.positions.size() + 1, 0);
  for (const auto& [from, to] : edges) {
    ++mesh.first_neighbor[from + 1];
    mesh.neighbors.push_back(to);
  }
  for (std::size_t i = 0; i < mesh.positions.size(); ++i)
    mesh.first_neighbor[i + 1] += mesh.first_neighbor[i];
}

/// Builds the mesh. `start(side, column, row)` is where a point begins.
template <class Start>
Mesh make_mesh(const std::vector<CageSide>& sides, std::uint32_t cells, const Start& start) {
  Mesh mesh;
  mesh.cells = cells;
  std::map<Lattice, std::uint32_t> known;
  for (std::size_t s = 0; s < sides.size(); ++s) {
    const CageSide& side = sides[s];
    const int columns = columns_of(side, cells), rows = side.rows * int(cells) + 1;
    std::vector<std::uint32_t>& vertices = mesh.sides.emplace_back();
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns; ++i) {
        const Lattice at = side.corner * int(cells) + side.along_column * i + side.along_row * j;
        const auto [entry, fresh] =
            known.try_emplace(at, static_cast<std::uint32_t>(mesh.positions.size()));
        if (fresh) mesh.positions.push_back(start(s, i, j));
        vertices.push_back(entry->second);
      }
    for (int j = 0; j + 1 < rows; ++j)
      for (int i = 0; i + 1 < columns; ++i) {
        const auto a = vertices.begin() + j * columns + i;
        mesh.quads.push_back({a[0], a[1], a[columns + 1], a[columns]});
      }
  }
  add_neighbors(mesh);
  return mesh;
}

/// Returns the coarse mesh's surface at a point of a side, in cells of the finer mesh.
math::Vec3 between(const Mesh& coarse, const CageSide& side, const std::vector<std::uint32_t>& grid,
                   std::uint32_t fine_cells, int column, int row) {
  const int m = int(coarse.cells), n = int(fine_cells), columns = columns_of(side, coarse.cells);
  const int i = std::min(column * m / n, side.columns * m - 1);
  const int j = std::min(row * m / n, side.rows * m - 1);
  const float s = float(column * m - i * n) / float(n), t = float(row * m - j * n) / float(n);
  const auto at = [&](int c, int r) {
    return coarse.positions[grid[std::size_t((j + r) * columns + i + c)]];
  };
  return (at(0, 0) * (1 - s) + at(1, 0) * s) * (1 - t) + (at(0, 1) * (1 - s) + at(1, 1) * s) * t;
}

std::vector<math::Vec3> normals_of(const Mesh& mesh) {
  std::vector<math::Vec3> normals(mesh.positions.size());
  for (const auto& q : mesh.quads) {
    const auto at = [&](std::size_t k) { return mesh.positions[q[k]]; };
    const math::Vec3 n = cross(at(2) - at(0), at(3) - at(1));
    for (const std::uint32_t v : q) normals[v] += n;
  }
  for (math::Vec3& n : normals) n = math::normalize(n);
  return normals;
}

/// Moves a point onto the solid's surface by Newton's steps.
math::Vec3 onto(const Solid& solid, math::Vec3 p, float reach_m, float coarse, int steps) {
  const float h = reach_m / 128;
  for (int k = 0; k < steps; ++k) {
    const float a = solid(p + math::Vec3{h, -h, -h}, coarse),
                b = solid(p + math::Vec3{-h, -h, h}, coarse),
                c = solid(p + math::Vec3{-h, h, -h}, coarse),
                d = solid(p + math::Vec3{h, h, h}, coarse);
    const math::Vec3 gradient =
        math::Vec3{a - b - c + d, -a - b + c + d, -a + b - c + d} * (1 / (4 * h));
    const float steepness = std::max(dot(gradient, gradient), 0.1f);
    math::Vec3 step = gradient * ((a + b + c + d) / 4 / steepness);
    const float far = length(step);
    if (far > reach_m) step = step * (reach_m / far);
    p = p - step;
  }
  return p;
}

math::Vec3 mean_of_neighbors(const Mesh& mesh, const std::vector<math::Vec3>& positions,
                             std::size_t vertex) {
  math::Vec3 sum;
  const std::uint32_t first = mesh.first_neighbor[vertex], end = mesh.first_neighbor[vertex + 1];
  for (std::uint32_t k = first; k < end; ++k) sum += positions[mesh.neighbors[k]];
  return sum * (1 / float(end - first));
}

/// Evens the points out along the surface, `rounds` times, and keeps them on it.
void relax(Mesh& mesh, const Cage& cage, const Solid& solid, int rounds, float coarse) {
  for (int round = 0; round < rounds; ++round) {
    const std::vector<math::Vec3> normals = normals_of(mesh), before = mesh.positions;
    for (std::size_t v = 0; v < before.size(); ++v) {
      math::Vec3 step = mean_of_neighbors(mesh, before, v) - before[v];
      step = step - normals[v] * dot(step, normals[v]);
      mesh.positions[v] = onto(solid, before[v] + step * 0.6f, cage.cube_m / 2, coarse, 1);
    }
  }
}

/// Returns which vertices belong to a triangle that looks away from one of their normals, and
/// those around them.
std::vector<bool> around_folds(const Mesh& mesh, int rings) {
  constexpr float kSteepest = 0.4f;  // the cosine between a triangle's normal and a vertex'
  const std::vector<math::Vec3> normals = normals_of(mesh);
  std::vector<bool> marked(mesh.positions.size(), false);
  const auto check = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const math::Vec3 p = mesh.positions[a];
    const math::Vec3 n = math::normalize(cross(mesh.positions[b] - p, mesh.positions[c] - p));
    if (std::min({dot(n, normals[a]), dot(n, normals[b]), dot(n, normals[c])}) < kSteepest)
      marked[a] = marked[b] = marked[c] = true;
  };
  for (const auto& q : mesh.quads) check(q[0], q[1], q[2]), check(q[0], q[2], q[3]);
  for (int ring = 0; ring < rings; ++ring) {
    const std::vector<bool> inner = marked;
    for (std::size_t v = 0; v < inner.size(); ++v)
      for (std::uint32_t k = mesh.first_neighbor[v]; inner[v] && k < mesh.first_neighbor[v + 1];
           ++k)
        marked[mesh.neighbors[k]] = true;
  }
  return marked;
}

/// Draws folds apart: the points around them go to the middle of their neighbors and back onto the
/// surface, until none is left or `rounds` have not been enough.
void unfold(Mesh& mesh, const Cage& cage, const Solid& solid, int rounds, float coarse) {
  for (int round = 0; round < rounds; ++round) {
    const std::vector<bool> marked = around_folds(mesh, 3);
    if (std::find(marked.begin(), marked.end(), true) == marked.end()) return;
    const std::vector<math::Vec3> before = mesh.positions;
    for (std::size_t v = 0; v < before.size(); ++v)
      if (marked[v])
        mesh.positions[v] =
            onto(solid, mean_of_neighbors(mesh, before, v), cage.cube_m / 2, coarse, 1);
  }
}

Mesh wrapped(const std::vector<CageSide>& sides, const Cage& cage, const Solid& solid,
             std::uint32_t cells) {
  std::vector<std::uint32_t> levels{cells};
  while (levels.back() > 2) levels.push_back((levels.back() + 1) / 2);
  Mesh mesh = make_mesh(sides, levels.back(), [&](std::size_t s, int i, int j) {
    const CageSide& side = sides[s];
    const float n = float(levels.back());
    const auto lattice = [&](std::size_t k) {
      return float(side.corner[k]) +
             (float(side.along_column[k] * i) + float(side.along_row[k] * j)) / n;
    };
    return cage.place({lattice(0), lattice(1), lattice(2)});
  });
  relax(mesh, cage, solid, 40, 1);
  for (std::size_t level = levels.size() - 1; level-- > 0;) {
    const Mesh coarse = std::move(mesh);
    mesh = make_mesh(sides, levels[level], [&](std::size_t s, int i, int j) {
      return between(coarse, sides[s], coarse.sides[s], levels[level], i, j);
    });
    const float softness = std::min(1.f, float(level) / 2);
    relax(mesh, cage, solid, level == 0 ? 8 : 16, softness);
  }
  unfold(mesh, cage, solid, 100, 0);
  for (math::Vec3& p : mesh.positions) p = onto(solid, p, cage.cube_m / 2, 0, 2);
  return mesh;
}

}  // namespace

void add_wrapped(SceneBuilder& scene, const Part& part, const Cage& cage, const Solid& solid,
                 std::uint32_t cells) {
  const std::vector<CageSide> sides = sides_of(cage);
  const Mesh mesh = wrapped(sides, cage, solid, cells);
  auto normals = std::make_shared<const std::vector<math::Vec3>>(normals_of(mesh));
  for (std::size_t s = 0; s < sides.size(); ++s) {
    const int columns = columns_of(sides[s], cells);
    const auto vertex = [&](std::uint32_t i, std::uint32_t j) {
      return mesh.sides[s][j * std::size_t(columns) + i];
    };
    add_sheet(
        scene, part,
        {std::uint32_t(sides[s].columns) * cells, std::uint32_t(sides[s].rows) * cells},
        [&](std::uint32_t i, std::uint32_t j) { return mesh.positions[vertex(i, j)]; },
        [&](std::uint32_t i, std::uint32_t j) { return (*normals)[vertex(i, j)]; });
  }
}

}  // namespace kiln::generate
