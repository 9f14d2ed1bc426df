#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/gltf_builder.h"

namespace kiln::test {

/// How a buffer view is to be compressed.
struct PackedView {
  std::string mode = "ATTRIBUTES", filter = "NONE";
  int stride = 4;
};

/// The document with its buffer views compressed by EXT_meshopt_compression, one spec for each;
/// the plain buffer becomes one without data. Filters other than NONE take what they decode: the
/// view holds four bytes of an octahedral normal, or EXPONENTIAL numbers, already.
GltfBuilder packed_by_meshopt(GltfBuilder plain, const std::vector<PackedView>& views);

/// One primitive whose data KHR_draco_mesh_compression holds alone, losslessly. Indices are shorts.
/// @param edgebreaker the encoding that orders vertices anew; else the sequential one
GltfBuilder packed_by_draco(const std::vector<float>& positions, const std::vector<float>& normals,
                            const std::vector<std::uint32_t>& indices, bool edgebreaker);

}  // namespace kiln::test
