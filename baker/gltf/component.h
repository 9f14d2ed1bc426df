#pragma once

#include <cstdint>

namespace kiln::gltf {

/// glTF component types.
enum class Component : std::uint16_t {
  kByte = 5120,
  kUnsignedByte = 5121,
  kShort = 5122,
  kUnsignedShort = 5123,
  kUnsignedInt = 5125,
  kFloat = 5126,
};

/// Of a number that may be none of them; 0 then.
constexpr std::uint32_t component_bytes(std::uint64_t type) {
  switch (type) {
    case std::uint64_t(Component::kByte):
    case std::uint64_t(Component::kUnsignedByte):
      return 1;
    case std::uint64_t(Component::kShort):
    case std::uint64_t(Component::kUnsignedShort):
      return 2;
    case std::uint64_t(Component::kUnsignedInt):
    case std::uint64_t(Component::kFloat):
      return 4;
    default:
      return 0;
  }
}
constexpr std::uint32_t component_bytes(Component type) {
  return component_bytes(std::uint64_t(type));
}

}  // namespace kiln::gltf
