#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "baker/gltf/document.h"
#include "proto/expected.h"

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

/// An accessor's elements, read one by one. Stride, sparse replacement, normalization and missing
/// buffer views (zeros) are dealt with here and nowhere else. Data may lie unaligned. The pointers
/// are views into the document's bytes; immutable.
struct AccessorView {
  const unsigned char* data = nullptr;  ///< nullptr: zeros
  std::size_t stride = 0;
  std::uint64_t count = 0;
  Component component = Component::kFloat;
  bool normalized = false;
  std::uint32_t components = 1;
  std::uint32_t element_bytes = 0;  ///< without padding between elements

  std::uint32_t sparse_count = 0;
  Component sparse_component = Component::kUnsignedInt;
  const unsigned char* sparse_indices = nullptr;
  const unsigned char* sparse_values = nullptr;  ///< tightly packed

  /// Returns the first component as an unsigned integer. Requires an unsigned type.
  std::uint32_t index(std::uint64_t i) const;
  /// Returns the components as floats, normalized ones mapped to [0, 1] or [-1, 1]
  /// [glTF 2.0, 3.11]. Requires at most four components.
  std::array<float, 4> floats(std::uint64_t i) const;
  /// Copies element i, i < count, to `out`: element_bytes bytes.
  void copy(std::uint64_t i, char* out) const;

 private:
  const unsigned char* element(std::uint64_t i) const;
};

/// Checks type, alignment, stride and range of every accessor against its buffer view.
/// Errors: `invalid_scene`, `canceled`.
proto::Expected<void> check_accessors(const Document&, const std::stop_token&);

/// The types that a use of an accessor allows.
struct AccessorFormat {
  std::uint32_t min_components = 1, max_components = 1;
  std::vector<std::pair<Component, bool>> types;  ///< component type, normalized
  bool allows_stride = true;
};

/// Opens accessors of one document and checks their contents at their first use: sparse indices
/// ascending and in range, no float that is NaN or infinite. Not for several threads at once.
class Accessors {
 public:
  Accessors(Document& document, std::stop_token stop);

  /// `use` is the property's name for messages. Errors: `invalid_scene`, `canceled`.
  proto::Expected<AccessorView> open(int accessor, const AccessorFormat&, const std::string& use);
  /// Opens an accessor for a copy of its elements, whatever its type: of the contents only the
  /// sparse indices are checked. Any index is safe. Errors: `invalid_scene`, `canceled`.
  proto::Expected<AccessorView> open_raw(std::uint64_t accessor) const;

 private:
  proto::Expected<AccessorView> view_of(int accessor) const;
  proto::Expected<void> check_sparse(const AccessorView&, const std::string& pointer) const;
  proto::Expected<void> check_contents(const AccessorView&, int accessor);

  Document& document_;
  std::stop_token stop_;
  std::vector<bool> checked_;
};

}  // namespace kiln::gltf
