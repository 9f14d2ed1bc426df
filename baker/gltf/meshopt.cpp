#include "baker/gltf/meshopt.h"

#include <meshoptimizer.h>

namespace kiln::gltf {
namespace {

using Decode = int (*)(void*, std::size_t, std::size_t, const unsigned char*, std::size_t);

Decode decoder_of(const std::string& mode) {
  if (mode == "ATTRIBUTES") return meshopt_decodeVertexBuffer;
  if (mode == "TRIANGLES") return meshopt_decodeIndexBuffer;
  return meshopt_decodeIndexSequence;
}

constexpr std::uint64_t kMaxCount = std::uint64_t{1} << 40;

/// The fewest bytes that hold the view: a quarter of a byte for every 16 of a column, a byte for
/// every triangle or index.
std::uint64_t least_bytes(const MeshoptView& v) {
  if (v.mode == "ATTRIBUTES") return v.bytes() / 64;
  return v.mode == "TRIANGLES" ? v.count / 3 : v.count;
}

/// Says why the stride can't be; the filters need strides of their own.
std::string wrong_stride(const MeshoptView& v) {
  if (v.mode != "ATTRIBUTES") {
    if (v.stride != 2 && v.stride != 4) return "indices have a byteStride of 2 or 4";
    if (v.filter != "NONE") return "indices have no filter";
    return "";
  }
  if (v.stride == 0 || v.stride > 256 || v.stride % 4 != 0)
    return "attributes have a byteStride of 4, 8 ... 256";
  if (v.filter == "OCTAHEDRAL" && v.stride != 4 && v.stride != 8)
    return "the octahedral filter has a byteStride of 4 or 8";
  if (v.filter == "QUATERNION" && v.stride != 8)
    return "the quaternion filter has a byteStride of 8";
  return "";
}

/// Says why data can't be decoded. It begins with a half-byte that names the mode, and another that
/// names the version.
std::string why_broken(const MeshoptView& v, std::string_view packed) {
  const bool attributes = v.mode == "ATTRIBUTES";
  const unsigned mode = attributes              ? 0xau
                        : v.mode == "TRIANGLES" ? 0xeu
                                                : 0xdu,
                 last_version = attributes ? 0u : 1u;
  const unsigned first = packed.empty() ? 0u : static_cast<unsigned char>(packed[0]);
  if (first >> 4 == mode && (first & 15u) > last_version)
    return "its data has version " + std::to_string(first & 15u) +
           " of the format, which EXT_meshopt_compression does not have";
  return "its data is damaged";
}

}  // namespace

std::string wrong_with(const MeshoptView& v, std::uint64_t packed_bytes, std::uint64_t plain_bytes,
                       std::uint64_t plain_stride) {
  if (auto why = wrong_stride(v); !why.empty()) return why;
  if (v.count == 0 || v.count > kMaxCount) return "its count can't be right";
  if (v.mode == "TRIANGLES" && v.count % 3 != 0) return "its count is no multiple of 3";
  if (v.bytes() != plain_bytes) return "count times byteStride is not the view's byteLength";
  if (plain_stride != 0 && plain_stride != v.stride) return "its byteStride is not the view's";
  if (packed_bytes < least_bytes(v)) return "its data is too short";
  return "";
}

std::string decode_meshopt(const MeshoptView& v, std::string_view packed, std::string& plain) {
  plain.assign(v.bytes(), '\0');
  const auto* from = reinterpret_cast<const unsigned char*>(packed.data());
  if (decoder_of(v.mode)(plain.data(), v.count, v.stride, from, packed.size()) != 0)
    return why_broken(v, packed);
  if (v.filter == "OCTAHEDRAL") meshopt_decodeFilterOct(plain.data(), v.count, v.stride);
  if (v.filter == "QUATERNION") meshopt_decodeFilterQuat(plain.data(), v.count, v.stride);
  if (v.filter == "EXPONENTIAL") meshopt_decodeFilterExp(plain.data(), v.count, v.stride);
  return "";
}

}  // namespace kiln::gltf
