#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"

namespace kiln::generate {

/// A test or demo scene, in real units, with valid lightmap UVs in TEXCOORD_1.
struct GeneratorInfo {
  std::string_view name, description;
};
std::vector<GeneratorInfo> generators();

inline constexpr std::uint32_t kMaxDetail = 1024;

/// Generates a scene as a .glb. The same arguments give the same bytes. All charts lie on one
/// scene-wide page, on whole texels of any power-of-two page from 128 up, with four empty texels of
/// 256 between them. `detail` is the number of cells along each of the six faces of a ball, or
/// along the sides of the cubes that a statue is made from (0: the scene's default). Other scenes
/// ignore it. Errors: `unknown_generator` (lists the names), `invalid_detail` (over kMaxDetail, or
/// over what the scene bears).
proto::Expected<std::string> generate_glb(std::string_view name, std::uint32_t detail = 0);

}  // namespace kiln::generate
