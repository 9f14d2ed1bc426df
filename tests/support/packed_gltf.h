#pragma once

#include <string>
#include <vector>

#include "support/gltf_builder.h"

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

}  // namespace kiln::test
