#pragma once

#include <stop_token>
#include <vector>

#include "baker/gltf/document.h"
#include "baker/import/graph.h"
#include "baker/scene/scene.h"
#include "proto/bake_settings.h"

namespace kiln::import {

/// Adds the lights of KHR_lights_punctual at the placed nodes to the scene.
/// Errors: `invalid_scene`, `limit_exceeded`.
proto::Expected<void> add_punctual_lights(scene::Scene&, gltf::Document&,
                                          const std::vector<PlacedNode>&,
                                          const files::ImportLimits&);

/// Adds the sky and the lights of the settings; a sky map that gives no light is dropped. A
/// rectangle is centered on its position; its width runs along the horizontal (along +X where it
/// faces straight up or down). Errors: `invalid_settings`: a light without a direction, or with an
/// empty cone or area; `missing_file`: the sky map was not imported; `canceled`.
proto::Expected<void> add_settings_lights(scene::Scene&, const proto::BakeSettings&,
                                          const std::stop_token&);

/// Returns the error `no_light` unless something emits. `emissive` tells whether a triangle with an
/// emissive material was found.
proto::Expected<void> require_light(const scene::Scene&, bool emissive, const proto::BakeSettings&);

}  // namespace kiln::import
