#pragma once

#include <bitset>
#include <cstddef>
#include <cstdint>
#include <initializer_list>

namespace kiln::lightmap {

/// Names a plane of a Lightmap. The order is that in which files and patches hold them.
enum class PlaneId : std::uint8_t {
  kDirect,
  kSky,
  kIndirect,
  kValidity,
  kDirectDifference,
  kSkyDifference,
  kIndirectDifference,
  kDirectSamples,
  kSamples,
  kDoublings,
  // A light has the following planes only if its method asks for them.
  kRadiosity,
  kGathers,
  kHits,
  kSeen,
  kClamped,
  kCount
};

/// A set of planes, by their ids.
using PlaneSet = std::bitset<64>;

inline PlaneSet plane_set(std::initializer_list<PlaneId> ids) {
  PlaneSet set;
  for (const PlaneId id : ids) set.set(std::size_t(id));
  return set;
}
inline bool contains(const PlaneSet& set, PlaneId id) {
  return set.test(std::size_t(id));
}

/// A plane that a method needs beside those of every light.
struct PlaneSpec {
  PlaneId id;
  std::uint32_t words = 1;  ///< values per texel; more than one in kHits and kSeen only
};

/// Returns the planes whose values passes share without a copy, see WordPlane. A pass that writes
/// one waits until no reader of the light before it is left, and a checkpoint stores them in a file
/// of their own.
inline PlaneSet shared_planes() {
  return plane_set({PlaneId::kHits, PlaneId::kSeen});
}

}  // namespace kiln::lightmap
