#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "baker/generate/builder.h"

/// Shapes that are made of curved pieces. None uses a transcendental function, because their last
/// bits vary between machines. Internal to this folder.
namespace kiln::generate {

/// Returns the cosine and the sine of `turns` times 2 pi. Points that mirror each other agree
/// exactly.
math::Vec2 on_circle(double turns);

/// Returns the point of the unit circle around Y, counterclockwise seen from above, from +X.
math::Vec3 around_y(double turns);

/// What a shape belongs to.
struct Part {
  std::string node;
  std::int32_t material = 0;
  /// How many times as long a sheet's chart is as those of others; its texture shrinks alike.
  float density = 1;
};

/// The cells of a sheet. Where it closes, the last column (row) lies on the first one.
struct SheetCells {
  std::uint32_t columns = 1, rows = 1;
  bool closes_columns = false, closes_rows = false;
};
using SheetPoint = std::function<math::Vec3(std::uint32_t column, std::uint32_t row)>;

/// Adds a grid of points as one chart of the surface's own size. Its front faces the direction of
/// d/d column x d/d row. Without `normal` (unit), normals are the mean of the faces around each
/// point.
void add_sheet(SceneBuilder&, const Part&, const SheetCells&, const SheetPoint&,
               const SheetPoint& normal = {});

/// Adds a flat or ruled piece by its corners, counterclockwise seen from the front.
void add_corners(SceneBuilder&, const Part&, math::Vec3 a, math::Vec3 b, math::Vec3 c,
                 math::Vec3 d);

void add_triangle(SceneBuilder&, const Part&, math::Vec3 a, math::Vec3 b, math::Vec3 c);
/// Adds faces of a box that look outwards. Faces share their corners exactly.
void add_box(SceneBuilder&, const Part&, const Box&, unsigned faces = kAllFaces);

/// Adds the surface between a ring of 4 n points and a point inside it, as one square chart of
/// n x n cells: a disc, or a cone where `middle` lies off the ring's plane. The ring runs
/// counterclockwise seen from the front.
void add_fan(SceneBuilder&, const Part&, const std::vector<math::Vec3>& ring, math::Vec3 middle);

/// A level ring of a lathe, its height over the lathe's foot.
struct LatheRing {
  float radius = 1, height = 0;
};
enum class Ends : std::uint8_t { kOpen, kTop, kBoth };

/// Adds a body of revolution around the upright through `foot`, from the lowest ring to the top.
/// `segments` is a multiple of four. The closed ends are discs.
void add_lathe(SceneBuilder&, const Part&, math::Vec3 foot, const std::vector<LatheRing>&,
               std::uint32_t segments, Ends);

/// The axes of a turned shape: unit, at right angles, right-handed.
struct Frame {
  math::Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
};

/// Adds a wheel, a rod or the like: a lathe whose axis is the frame's Y.
void add_turned_lathe(SceneBuilder&, const Part&, math::Vec3 foot, const Frame&,
                      const std::vector<LatheRing>&, std::uint32_t segments, Ends);

/// Adds a ring of round section, whose axis is the frame's Y.
void add_torus(SceneBuilder&, const Part&, math::Vec3 center, const Frame&, float radius,
               float section_radius, std::uint32_t segments, std::uint32_t section_segments);

/// The cells along each side of the cube that becomes an ellipsoid.
struct CubeCells {
  std::uint32_t x = 1, y = 1, z = 1;
};
void add_ellipsoid(SceneBuilder&, const Part&, math::Vec3 center, math::Vec3 radii,
                   const CubeCells&);

/// Adds a pyramid on a level rectangle, without its base unless `closed`.
void add_pyramid(SceneBuilder&, const Part&, math::Vec3 bottom, math::Vec3 size, math::Vec3 axis_x,
                 bool closed);

}  // namespace kiln::generate
