#pragma once

#include <stop_token>
#include <string>

#include "baker/gltf/document.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::import {

/// The setting sky.map: `name` is that of a side file, OpenEXR or Radiance by its first bytes.
/// Errors have the place /sky/map of the settings.

/// Checks everything short of decoding: that the file is there, and what its header says.
/// Errors: `missing_file`, `invalid_image`, `limit_exceeded`.
proto::Expected<void> check_sky_map(gltf::Document&, const std::string& name,
                                    const files::ImportLimits&);

/// Decodes it into scene.sky_map, as linear Rec. 709: by the primaries that the file names.
/// Negative values become 0, with a warning, those of colors beyond Rec. 709 among them. Errors:
/// those of check_sky_map(), `canceled`; values that are infinite, no number, or above kMaxSkyValue
/// are `invalid_image`: dropping them could drop the sun.
proto::Expected<void> load_sky_map(gltf::Document&, scene::Scene&, const std::string& name,
                                   const files::ImportLimits&, const std::stop_token&);

}  // namespace kiln::import
