#pragma once

#include <stop_token>

#include "baker/gltf/document.h"
#include "baker/scene/scene.h"

namespace kiln::import {

/// Decodes the images that materials of `scene` name (glTF indices until then), each once, and
/// makes the textures name Scene::images instead. PNG, JPEG and WebP by their first bytes, any
/// depth and number of channels; other formats are left out with a warning, so that the factor
/// alone is used. Errors: `invalid_image`, `missing_file`, `limit_exceeded`, `canceled`.
proto::Expected<void> load_images(gltf::Document&, scene::Scene&, const files::ImportLimits&,
                                  const std::stop_token&);

/// Checks everything that load_images() does short of decoding: the sources exist.
proto::Expected<void> find_images(gltf::Document&, const std::vector<scene::Material>&);

}  // namespace kiln::import
