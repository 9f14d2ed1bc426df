#pragma once

#include <cstdint>
#include <string_view>

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

/// Returns the bytes of a component; 0 for a number that is no component type.
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

/// Returns the components of a glTF element type, SCALAR or VEC; 0 for matrices and other words.
constexpr std::uint32_t vector_components(std::string_view type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  return type == "VEC4" ? 4 : 0;
}

}  // namespace kiln::gltf
