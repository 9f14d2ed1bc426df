#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "baker/math/vec.h"

namespace kiln::gltf {

/// A small glTF document to be written: what the generated scenes need of glTF 2.0. Indices refer
/// to the vectors of GlbDocument; -1 means none. Units as in glTF: meters, linear Rec. 709, cd/m2.
struct GlbMaterial {
  std::string name;
  math::Rgb base_color{1, 1, 1};
  math::Rgb emission;  ///< cd/m2; what exceeds 1 goes to KHR_materials_emissive_strength
  std::int32_t base_image = -1, emission_image = -1;  ///< through TEXCOORD_0, repeating
  bool double_sided = false;
};

/// Vertex arrays run in parallel.
struct GlbPrimitive {
  std::int32_t material = -1;
  std::vector<math::Vec3> positions, normals;
  std::vector<math::Vec2> uv0, uv1;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

struct GlbMesh {
  std::string name;
  std::vector<GlbPrimitive> primitives;
};

/// KHR_lights_punctual. Angles in radians; range 0 = unlimited.
struct GlbLight {
  enum class Type : std::uint8_t { kDirectional, kPoint, kSpot };
  Type type = Type::kPoint;
  std::string name;
  math::Rgb color{1, 1, 1};
  float intensity = 1;  ///< lx (directional) or cd
  float range = 0;
  float inner_cone = 0, outer_cone = 0.7853982f;
};

struct GlbNode {
  std::string name;
  std::int32_t mesh = -1, light = -1;
  math::Vec3 translation;
  math::Vec3 direction{0, 0, -1};  ///< unit: where the node's -Z points; becomes the rotation
};

struct GlbDocument {
  std::string name;
  std::vector<GlbMaterial> materials;
  std::vector<GlbMesh> meshes;
  std::vector<GlbLight> lights;
  std::vector<GlbNode> nodes;
  std::vector<std::string> images;  ///< PNG files
};

/// The document as the bytes of a .glb. Same document, same bytes.
std::string write_glb(const GlbDocument&);

}  // namespace kiln::gltf
