#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "baker/math/vec.h"
#include "proto/manifest.h"

namespace kiln::scene {

/// The highest albedo. Every method caps albedo here and reports it, since the Neumann series would
/// diverge near 1.
inline constexpr float kMaxAlbedo = 0.98f;

enum class Wrap : std::uint8_t { kRepeat, kMirror, kClamp };

/// A decoded image: Rec. 709 RGBA, row 0 = top. Color channels keep their 8-bit sRGB codes, which
/// srgb_to_linear() decodes. Alpha is linear.
struct Image {
  std::uint32_t width = 0, height = 0;
  std::uint64_t first_texel = 0;  ///< into Scene::image_texels, width*height entries
};

/// An image seen through a sampler, which is bilinear, or `nearest` where the glTF asks for it.
struct Texture {
  std::int32_t image = -1;  ///< -1: there is none, and it reads as 1
  Wrap wrap_u = Wrap::kRepeat, wrap_v = Wrap::kRepeat;
  bool nearest = false;
};

enum class AlphaMode : std::uint8_t { kOpaque, kMask, kBlend };

struct Material {
  math::Rgb base_color{1, 1, 1};  ///< linear factor; albedo = factor * texture * COLOR_0
  math::Rgb emission;             ///< cd/m2: emissiveFactor * KHR_materials_emissive_strength
  Texture base_texture, emission_texture;
  bool double_sided = false;
  AlphaMode alpha_mode = AlphaMode::kOpaque;
  float alpha_cutoff = 0.5f;
  std::int32_t source = -1;  ///< index in the glTF; -1: the default material
};

/// One glTF primitive under one node: a run of vertices and of triangles. Parts are sorted by
/// instance; a primitive that holds no triangle (points, lines, all degenerate) has no part.
struct Part {
  std::uint32_t instance = 0;
  std::uint32_t primitive = 0;                       ///< index in the glTF mesh
  std::uint32_t material = 0;                        ///< into Scene::materials
  std::uint32_t first_vertex = 0, vertex_count = 0;  ///< see Scene::source_vertex
  std::uint32_t first_triangle = 0, triangle_count = 0;
  bool has_lightmap_uv = false;  ///< the primitive has TEXCOORD_1
};

/// A node that carries a mesh.
struct Instance {
  std::uint32_t node = 0, mesh = 0;  ///< indices in the glTF
  std::string name;                  ///< the node's name, or else the mesh's
  std::uint32_t first_part = 0, part_count = 0;
  /// The node's transform mirrors, so scene triangles list (a, c, b) where the glTF lists (a, b,
  /// c).
  bool mirrored = false;
};

enum class PunctualType : std::uint8_t { kDirectional, kPoint, kSpot };

/// KHR_lights_punctual, in world space.
struct PunctualLight {
  PunctualType type = PunctualType::kPoint;
  math::Rgb intensity;                 ///< color * intensity: lx (directional) or cd
  math::Vec3 position;                 ///< m
  math::Vec3 direction{0, 0, -1};      ///< unit, the direction in which the light travels
  float range = 0;                     ///< m; 0: unlimited
  float cos_inner = 1, cos_outer = 0;  ///< spot cone
};

/// A camera of the glTF, in world space. A picture's own size says how wide it is.
struct Camera {
  static constexpr std::size_t kMost = 256;       ///< cameras of a scene
  static constexpr std::size_t kNameBytes = 260;  ///< at most, of a name

  std::string name;                           ///< the node's name, or else the camera's
  math::Vec3 position;                        ///< m
  math::Vec3 forward{0, 0, -1}, up{0, 1, 0};  ///< unit, as far as rounding goes perpendicular
  bool orthographic = false;
  float half_height = 1;  ///< of the picture, m; of a perspective one at a distance of 1 m
};

/// A one-sided emitting rectangle that is not part of the geometry: it lights the scene, but no ray
/// hits it.
struct RectLight {
  math::Vec3 corner, edge_u, edge_v;  ///< m; emits towards cross(edge_u, edge_v)
  math::Rgb radiance;                 ///< cd/m2
};

/// The largest value in a sky map.
inline constexpr float kMaxSkyValue = 1e12f;

/// Radiance from outside the scene by direction: an equirectangular picture, row 0 at +Y. Its
/// center is seen along +X, and the middle of its right half along +Z; then it is turned about +Y.
/// The radiance is constant over a pixel.
struct SkyMap {
  std::uint32_t width = 0, height = 0;  ///< width = 2 * height; 0: there is no map
  std::vector<math::Rgb> texels;        ///< each in [0, kMaxSkyValue]
  float scale = 1;                      ///< cd/m2 for a value of 1
  float rotation = 0;                   ///< rad, counter-clockwise seen from above

  bool empty() const { return texels.empty(); }
};

/// Everything that a bake reads, in flat arrays of plain data, so that it can be written to a file
/// and mapped. Coordinates are world space in meters, +Y up, right-handed. Vertex arrays run in
/// parallel. A scene is immutable once it is built.
struct Scene {
  std::vector<math::Vec3> positions;
  std::vector<math::Vec3> normals;  ///< unit; flat normals where the source has none
  std::vector<math::Vec2>
      base_uv;  ///< UV of the material's base texture, KHR_texture_transform applied
  std::vector<math::Vec2> emission_uv;       ///< UV of its emission texture, likewise
  std::vector<math::Vec2> lightmap_uv;       ///< TEXCOORD_1; (0,0) where the part has none
  std::vector<std::array<float, 4>> colors;  ///< COLOR_0, linear; 1 where absent
  /// The element of the glTF primitive's accessors that each vertex comes from. A part holds the
  /// vertices that its triangles use and no others, in ascending order of this index, each once.
  /// Where the primitive has no normals it holds three for each triangle in turn, so that faces are
  /// flat. Two faces of one part are joined where they share source vertices, not scene vertices.
  std::vector<std::uint32_t> source_vertex;

  /// Vertex indices, counter-clockwise seen from the front (those of a mirrored node are swapped).
  /// No index is out of range, and no triangle has zero area or a repeated vertex.
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint32_t> triangle_part;

  std::vector<Part> parts;
  std::vector<Instance> instances;
  std::vector<Material> materials;
  std::vector<Image> images;
  std::vector<std::array<std::uint8_t, 4>> image_texels;
  std::vector<PunctualLight> lights;
  std::vector<RectLight> rect_lights;
  math::Rgb sky;   ///< cd/m2, the same in every direction
  SkyMap sky_map;  ///< it adds to `sky`

  std::vector<Camera> cameras;           ///< no light depends on them
  std::vector<proto::Warning> warnings;  ///< what the import ignored or changed

  const Material& material_of(std::uint32_t triangle) const {
    return materials[parts[triangle_part[triangle]].material];
  }
  bool has_sky() const { return !is_black(sky) || !sky_map.empty(); }
};

/// Returns the memory that a scene's arrays take, but for those of its sky map. Bytes.
std::uint64_t memory_bytes(const Scene&);

/// A point on a triangle: p = (1-u-v)*p0 + u*p1 + v*p2, as Embree reports hits.
struct Bary {
  float u = 0, v = 0;
};
inline constexpr Bary kCentroid{1 / 3.f, 1 / 3.f};
inline math::Vec3 interpolate(math::Vec3 a, math::Vec3 b, math::Vec3 c, Bary t) {
  return a * (1 - t.u - t.v) + b * t.u + c * t.v;
}
math::Vec3 position_at(const Scene&, std::uint32_t triangle, Bary);
/// Returns the unit normal by the right-hand rule over the triangle's vertices.
math::Vec3 geometric_normal(const Scene&, std::uint32_t triangle);
/// Returns the interpolated vertex normal, unit, on the geometric normal's side.
math::Vec3 shading_normal(const Scene&, std::uint32_t triangle, Bary);
float triangle_area(const Scene&, std::uint32_t triangle);  ///< m2
/// Returns whether three points can be a triangle of a scene, which requires that
/// geometric_normal() can make a unit vector of their cross product.
inline bool has_area(math::Vec3 a, math::Vec3 b, math::Vec3 c) {
  const math::Vec3 n = cross(b - a, c - a);
  return dot(n, n) >= std::numeric_limits<float>::min();
}
/// Returns the albedo before the cap: factor * texture * vertex color, each channel in [0, 1].
math::Rgb albedo_at(const Scene&, std::uint32_t triangle, Bary);
/// Returns the share of a surface that is there, texture * vertex color: 0 is a hole, 1 is opaque.
/// The factor of the material is not in it, and a bake takes every surface for opaque.
float alpha_at(const Scene&, std::uint32_t triangle, Bary);
/// Returns the emitted radiance, cd/m2.
math::Rgb emission_at(const Scene&, std::uint32_t triangle, Bary);
/// Returns whether any point of the triangle may emit (its factor is not black).
bool is_emissive(const Scene&, std::uint32_t triangle);

/// Converts an sRGB code value (0..255) to linear (0..1), IEC 61966-2-1.
float srgb_to_linear(std::uint8_t code);

}  // namespace kiln::scene
