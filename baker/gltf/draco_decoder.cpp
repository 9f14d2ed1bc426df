#include "baker/gltf/draco_decoder.h"

#include <draco/compression/decode.h>

#include <cstring>
#include <new>
#include <optional>

#include "baker/gltf/component.h"

namespace kiln::gltf {
namespace {

using proto::Expected;

proto::Unexpected broken(const std::string& why) {
  return proto::fail("invalid_scene", why);
}

std::optional<std::uint64_t> take_varint(std::string_view& bytes) {
  std::uint64_t value = 0;
  for (unsigned shift = 0; shift < 35 && !bytes.empty(); shift += 7) {
    const auto byte = static_cast<unsigned char>(bytes.front());
    bytes.remove_prefix(1);
    value |= std::uint64_t(byte & 0x7fu) << shift;
    if ((byte & 0x80u) == 0) return value;
  }
  return std::nullopt;
}

/// What the library would take memory by: it believes the header. "" when that is what the document
/// says, or lies behind metadata; then the process's own limit has to do [Draco bitstream
/// specification 2.2, sections 4 and 5].
std::string wrong_header(std::string_view bytes, const DracoRequest& request) {
  constexpr std::size_t kHeader = 11;
  constexpr unsigned char kTriangles = 1, kSequential = 0, kEdgebreaker = 1, kMetadata = 0x80;
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  if (bytes.size() < kHeader + 1 || !bytes.starts_with("DRACO")) return "it has no Draco header";
  if (byte(5) != 2 || byte(6) != 2) return "its version is not 2.2";
  if (byte(7) != kTriangles) return "it is no triangle mesh";
  const bool edgebreaker = byte(8) == kEdgebreaker;
  if (!edgebreaker && byte(8) != kSequential) return "its encoding is unknown";
  if ((byte(10) & kMetadata) != 0) return "";
  std::string_view rest = bytes.substr(kHeader + (edgebreaker ? 1 : 0));
  auto first = take_varint(rest), second = take_varint(rest);
  if (!first || !second) return "its header ends too early";
  if (edgebreaker) std::swap(first, second);  // vertices come first there
  const std::uint64_t faces = *first, vertices = *second;
  if (3 * faces != request.indices)
    return "it has " + std::to_string(faces) + " triangles, the indices' accessor " +
           std::to_string(request.indices) + " elements";
  // Edgebreaker counts vertices before seams split them.
  if (vertices > request.vertices) return "it has more vertices than the accessors";
  return "";
}

template <class T>
std::string plain_indices(const draco::Mesh& mesh) {
  std::string out(std::size_t(mesh.num_faces()) * 3 * sizeof(T), '\0');
  char* to = out.data();
  for (draco::FaceIndex f(0); f < mesh.num_faces(); ++f)
    for (const draco::PointIndex& point : mesh.face(f)) {
      const T index = static_cast<T>(point.value());
      std::memcpy(to, &index, sizeof index);
      to += sizeof index;
    }
  return out;
}

template <class T>
std::optional<std::string> plain_values(const draco::PointAttribute& from, std::uint32_t points,
                                        const DracoAttribute& want) {
  const std::size_t stride = draco_stride(want);
  std::string out(points * stride, '\0');
  T values[4] = {};
  for (std::uint32_t p = 0; p < points; ++p) {
    const draco::AttributeValueIndex i = from.mapped_index(draco::PointIndex(p));
    if (i.value() >= from.size() ||
        !from.ConvertValue<T>(i, static_cast<std::int8_t>(want.components), values))
      return std::nullopt;
    std::memcpy(&out[p * stride], values, want.components * sizeof(T));
  }
  return out;
}

std::optional<std::string> plain_values(const draco::Mesh& mesh, const DracoAttribute& want) {
  if (want.id > 0xffffffffu || draco_stride(want) == 0) return std::nullopt;
  const auto* from = mesh.GetAttributeByUniqueId(static_cast<std::uint32_t>(want.id));
  const std::uint32_t points = mesh.num_points();
  if (!from || from->num_components() < 1) return std::nullopt;
  if (!from->is_mapping_identity() && from->indices_map_size() < points) return std::nullopt;
  switch (want.component_type) {
    case 5120:
      return plain_values<std::int8_t>(*from, points, want);
    case 5121:
      return plain_values<std::uint8_t>(*from, points, want);
    case 5122:
      return plain_values<std::int16_t>(*from, points, want);
    case 5123:
      return plain_values<std::uint16_t>(*from, points, want);
    case 5125:
      return plain_values<std::uint32_t>(*from, points, want);
    default:
      return plain_values<float>(*from, points, want);
  }
}

bool faces_fit(const draco::Mesh& mesh) {
  for (draco::FaceIndex f(0); f < mesh.num_faces(); ++f)
    for (const draco::PointIndex& point : mesh.face(f))
      if (point.value() >= mesh.num_points()) return false;
  return true;
}

}  // namespace

std::uint32_t draco_stride(const DracoAttribute& a) {
  if (a.components < 1 || a.components > 4) return 0;
  return (component_bytes(a.component_type) * a.components + 3) / 4 * 4;
}

proto::Expected<DracoMesh> decode_draco(std::string_view bytes, const DracoRequest& request) {
  if (auto why = wrong_header(bytes, request); !why.empty()) return broken(why);
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) return broken("it can't be decoded: " + decoded.status().error_msg_string());
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
  if (mesh->num_points() != request.vertices || 3ull * mesh->num_faces() != request.indices)
    return broken("it has " + std::to_string(mesh->num_points()) + " vertices and " +
                  std::to_string(mesh->num_faces()) + " triangles, the accessors others");
  if (!faces_fit(*mesh)) return broken("its triangles are damaged");
  DracoMesh out;
  const bool fits_short = mesh->num_points() <= 0x10000, fits_byte = mesh->num_points() <= 0x100;
  if ((request.index_type == 5123 && !fits_short) || (request.index_type == 5121 && !fits_byte))
    return broken("its indices do not fit into their accessor");
  if (request.index_type == 5121) out.indices = plain_indices<std::uint8_t>(*mesh);
  if (request.index_type == 5123) out.indices = plain_indices<std::uint16_t>(*mesh);
  if (request.index_type == 5125) out.indices = plain_indices<std::uint32_t>(*mesh);
  for (const DracoAttribute& want : request.attributes) {
    auto values = plain_values(*mesh, want);
    if (!values) return broken("its attribute " + std::to_string(want.id) + " can't be read");
    out.attributes.push_back(std::move(*values));
  }
  return out;
}

}  // namespace kiln::gltf
