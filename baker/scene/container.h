#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::baker {

/// A whole file. Errors: `limit_exceeded` when it is longer than `max_bytes` (found out before
/// memory is taken), `missing_file` when it can't be read.
proto::Expected<std::string> read_file(const std::filesystem::path&, std::uint64_t max_bytes);

/// The two parts of a glTF file; views into its bytes.
struct Container {
  std::string_view json;
  std::optional<std::string_view> binary;  ///< BIN chunk of a .glb, padding included
};

/// Splits a .glb into its chunks; any other file is taken for a .gltf, all JSON.
/// Errors: `invalid_scene`: wrong magic or version, truncated, chunks missing, twice or out of
/// order.
proto::Expected<Container> open_container(std::string_view bytes);

}  // namespace kiln::baker
