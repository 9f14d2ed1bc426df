#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace kiln::gltf {

/// EXT_meshopt_compression of one buffer view.
struct MeshoptView {
  std::uint64_t count = 0, stride = 0;
  std::string mode, filter = "NONE";

  std::uint64_t bytes() const { return count * stride; }
};

/// Says what is wrong with a compressed view of `packed_bytes`, which stands for one of
/// `plain_bytes` whose own stride is `plain_stride` (0: it has none); "" when it can be decoded.
/// The numbers are those that glTF allows. A view that passes decodes to at most 64 times its
/// packed bytes.
std::string wrong_with(const MeshoptView&, std::uint64_t packed_bytes, std::uint64_t plain_bytes,
                       std::uint64_t plain_stride);

/// Decodes the view's bytes by meshoptimizer, which takes any input. Requires that nothing is wrong
/// with the view. Returns "", or why the packed bytes can't be decoded.
std::string decode_meshopt(const MeshoptView&, std::string_view packed, std::string& plain);

}  // namespace kiln::gltf
