#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::baker {

/// Test and demo scenes, in real units, with valid lightmap UVs in TEXCOORD_1.
struct GeneratorInfo {
  std::string_view name, description;
};
std::vector<GeneratorInfo> generators();

/// The scene as a .glb. `detail` is the tessellation of curved and bumpy parts (0: the default).
/// Errors: `unknown_generator` (lists the names).
proto::Expected<std::string> generate_glb(std::string_view name, std::uint32_t detail = 0);

}  // namespace kiln::baker
