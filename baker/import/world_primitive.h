#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/import/primitive_source.h"
#include "baker/import/transform.h"

namespace kiln::import {

/// A primitive in world space, as Scene wants it; triangles count from its own first vertex.
struct WorldPrimitive {
  std::vector<math::Vec3> positions, normals;
  std::vector<std::uint32_t> source_vertex;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::uint64_t degenerate = 0;      ///< triangles without area, left out
  std::uint64_t broken_normals = 0;  ///< zero normals, replaced by those of the faces
};

/// Assembles a primitive's triangles from lists, strips and fans.
/// Errors: `invalid_scene` when positions leave [-1e9 m, 1e9 m], `canceled`.
proto::Expected<WorldPrimitive> place_primitive(const PrimitiveSource&, const Transform& to_world,
                                                const std::stop_token&);

/// Says whether place_primitive() would leave any triangle. Same errors, but it takes no memory.
proto::Expected<bool> has_triangles(const PrimitiveSource&, const Transform& to_world,
                                    const std::stop_token&);

}  // namespace kiln::import
