#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "baker/gltf/glb_writer.h"
#include "baker/math/vec.h"

/// Builds the generated scenes. Internal to this folder.
namespace kiln::generate {

/// A point of a surface with its unit normal.
struct SurfacePoint {
  math::Vec3 position, normal;
};

/// A piece of surface that becomes one chart: a grid of points. Its front faces the direction of
/// d/d column x d/d row.
struct Patch {
  std::string node;
  std::int32_t material = 0;
  float width_m = 1, height_m = 1;  ///< wanted size of the chart
  std::uint32_t columns = 1, rows = 1;
  bool triangle = false;  ///< the patch is the half of one cell below the diagonal
  /// Returns the grid point (0..columns, 0..rows). The arguments are integers, so that faces which
  /// share an edge agree exactly.
  std::function<SurfacePoint(std::uint32_t column, std::uint32_t row)> at;
};

/// An axis-aligned or turned box; `bottom` is the center of the lower face.
struct Box {
  math::Vec3 bottom, size;
  math::Vec3 axis_x{1, 0, 0};  ///< unit and level; the box's Z follows from it
};

enum BoxFace : unsigned {
  kFloor = 1,
  kCeiling = 2,
  kLeft = 4,
  kRight = 8,
  kBack = 16,
  kFront = 32,
  kAllFaces = 63,
};

/// A face of the cube [-1,1]^3: its center, and edges with center = edge_u x edge_v.
struct CubeFace {
  BoxFace face;
  math::Vec3 center, edge_u, edge_v;
};
inline constexpr std::array<CubeFace, 6> kCube{{{kFloor, {0, -1, 0}, {1, 0, 0}, {0, 0, 1}},
                                                {kCeiling, {0, 1, 0}, {1, 0, 0}, {0, 0, -1}},
                                                {kLeft, {-1, 0, 0}, {0, 0, 1}, {0, 1, 0}},
                                                {kRight, {1, 0, 0}, {0, 0, -1}, {0, 1, 0}},
                                                {kBack, {0, 0, -1}, {-1, 0, 0}, {0, 1, 0}},
                                                {kFront, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}}}};

/// Returns the radius of a ball in a direction (unit) as a multiple of its mean radius.
using Relief = std::function<float(math::Vec3 direction)>;

class SceneBuilder {
 public:
  explicit SceneBuilder(std::string name) { doc_.name = std::move(name); }

  std::int32_t material(std::string name, math::Rgb base_color, math::Rgb emission = {});
  /// Gives a material an image as its color or, where it emits, as its emission. One repeat covers
  /// `size_m` meters.
  void texture(std::int32_t material, std::string png, float size_m);

  /// Adds a piece of surface of any shape.
  void surface(Patch patch) { patches_.push_back(std::move(patch)); }
  /// Adds a parallelogram, whose front faces the direction of edge_u x edge_v.
  void quad(const std::string& node, std::int32_t material, math::Vec3 corner, math::Vec3 edge_u,
            math::Vec3 edge_v);
  void triangle(const std::string& node, std::int32_t material, math::Vec3 corner,
                math::Vec3 edge_u, math::Vec3 edge_v);
  /// Adds faces of a box that look outwards (a solid) or inwards (a room).
  void solid(const std::string& node, std::int32_t material, const Box&,
             unsigned faces = kAllFaces);
  void room(const std::string& node, std::int32_t material, const Box&, unsigned faces = kAllFaces);
  /// Adds a sphere made of the six faces of a cube, `detail` x `detail` cells each.
  void ball(const std::string& node, std::int32_t material, math::Vec3 center, float radius,
            std::uint32_t detail, const Relief& relief = {});
  void light(gltf::GlbLight, math::Vec3 position, math::Vec3 direction = {0, 0, -1});

  /// Lays all charts out on one page, without overlap and at least four texels of 256 apart, and
  /// writes the .glb.
  std::string finish();

 private:
  void faces(const std::string& node, std::int32_t material, const Box&, unsigned faces,
             bool inwards);
  gltf::GlbPrimitive& primitive_of(const Patch&);

  gltf::GlbDocument doc_;
  std::vector<float> texture_size_m_;  ///< parallel to doc_.materials
  std::vector<Patch> patches_;
};

/// The place of a chart, in cells of 1/kCells of the page.
struct CellRect {
  std::uint32_t x = 0, y = 0, width = 0, height = 0;
};
/// The number of cells along a page. A cell is a whole number of texels at every power-of-two page
/// size from 128 up.
inline constexpr std::uint32_t kCells = 128;

/// Packs charts into rows, tallest first, at the largest common scale that fits. Sizes are in
/// meters; each side gets at least one cell. Two cells stay empty between charts, one along the
/// page's border.
std::vector<CellRect> pack_charts(const std::vector<math::Vec2>& sizes_m);

/// Encodes a size x size PNG, sRGB, from the codes that `color(x, y)` returns.
std::string make_png(
    std::uint32_t size,
    const std::function<std::array<std::uint8_t, 3>(std::uint32_t x, std::uint32_t y)>& color);

}  // namespace kiln::generate
