#pragma once

#include <vector>

#include "baker/gltf/document.h"
#include "baker/import/graph.h"
#include "baker/scene/scene.h"

namespace kiln::import {

/// Adds the cameras of the placed nodes, in document order. One that shows nothing (no size, no
/// direction, a place that is not finite) is left out with a warning, and so are those beyond
/// scene::Camera::kMost: a scene can be baked without them.
void add_cameras(scene::Scene&, gltf::Document&, const std::vector<PlacedNode>&);

}  // namespace kiln::import
