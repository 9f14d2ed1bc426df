#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string_view>

namespace kiln::gltf {

/// Types of glTF properties.
enum class Kind {
  kBool,
  kString,
  kWord,        ///< one of the words of `target`, which are parted by spaces
  kInteger,     ///< in [low, high]
  kNumber,      ///< in [low, high]; fits a float
  kNumbers,     ///< array of `length` kNumbers, any length when 0
  kIndex,       ///< into the collection `target`
  kIndices,     ///< array of those
  kIndexMap,    ///< object whose members are kIndex
  kIndexMaps,   ///< array of those
  kIntegerMap,  ///< object whose members are kInteger
  kStrings,
  kObject,   ///< described by `fields`
  kObjects,  ///< array of those
};

/// One property of a glTF object. What is not listed is not read by a bake, and is removed.
struct Field {
  std::string_view name;
  Kind kind;
  bool required = false;
  const char* target = nullptr;
  std::span<const Field> fields{};
  std::size_t length = 0;
  double low = std::numeric_limits<double>::lowest(), high = std::numeric_limits<double>::max();
};

inline constexpr double kMaxSize = 9007199254740991.0;  // 2^53 - 1: exact in JSON
inline constexpr double kMaxOffset = 2147483647;  // sparse offsets and counts: int in the library

/// The parts of glTF 2.0 and of its extensions that a bake reads: the document's own properties,
/// and theirs under them.
std::span<const Field> gltf_fields();

}  // namespace kiln::gltf
