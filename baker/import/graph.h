#pragma once

#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/gltf/document.h"
#include "baker/import/transform.h"
#include "proto/expected.h"

namespace kiln::import {

/// A node of the scene to bake, with its transform to world space.
struct PlacedNode {
  std::uint32_t node = 0;
  Transform to_world;
};

/// Returns the nodes of the document's scene (`scene`, else the first; a file without scenes: all
/// roots, with a warning), parents before children, in document order. Errors: `invalid_scene`:
/// cycles, nodes with two parents, a scene that lists a child, transforms that aren't affine;
/// `limit_exceeded`: too deep; `canceled`.
proto::Expected<std::vector<PlacedNode>> place_nodes(gltf::Document&, const files::ImportLimits&,
                                                     const std::stop_token&);

}  // namespace kiln::import
