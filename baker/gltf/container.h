#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::gltf {

/// The two parts of a glTF file; views into its bytes.
struct Container {
  std::string_view json;
  std::optional<std::string_view> binary;  ///< BIN chunk of a .glb, padding included
};

/// Lengths in a .glb are 32 bits.
inline constexpr std::uint64_t kMaxGlbBytes = 0xffffffff;

/// Splits a .glb into its chunks; any other file is taken for a .gltf, all JSON.
/// Errors: `invalid_scene`: wrong magic or version, truncated, chunks missing, twice or out of
/// order.
proto::Expected<Container> open_container(std::string_view bytes);

}  // namespace kiln::gltf
