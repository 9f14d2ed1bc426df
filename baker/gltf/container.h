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

/// Returns the little-endian number at `offset`. Requires four bytes there.
std::uint32_t u32_at(std::string_view bytes, std::size_t offset);

/// Returns the start of a .glb up to the data of its BIN chunk: header, JSON chunk and the BIN
/// chunk's header. Requires `binary_bytes` to be a multiple of 4, as all chunks are, and
/// glb_bytes() to be at most kMaxGlbBytes.
std::string glb_head(std::string json, std::uint64_t binary_bytes);
/// Returns the length of the whole file.
std::uint64_t glb_bytes(std::size_t json_bytes, std::uint64_t binary_bytes);

/// Splits a .glb into its chunks; takes any other file for a .gltf, all JSON.
/// Errors: `invalid_scene`: wrong magic or version, truncated, chunks missing, twice or out of
/// order.
proto::Expected<Container> open_container(std::string_view bytes);

}  // namespace kiln::gltf
