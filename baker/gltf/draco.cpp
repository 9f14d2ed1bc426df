#include "baker/gltf/draco.h"

#include <draco/compression/decode.h>

#include <cstring>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>

#include "baker/exec/stop.h"
#include "baker/gltf/accessors.h"
#include "baker/gltf/findings.h"

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

/// Compares the header with the document, since the library believes the header and takes memory by
/// it. Returns what differs; "" when nothing does, or when the numbers lie behind metadata: the
/// process's own limit then has to do [Draco bitstream specification 2.2, sections 4 and 5].
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

namespace {

constexpr const char* kName = "KHR_draco_mesh_compression";

/// Returns the components of an accessor's element; 0 for a matrix.
std::uint32_t components_of(const Json& accessor) {
  const auto type = accessor.find("type");
  if (type == accessor.end() || !type->is_string()) return 0;
  return vector_components(type->get_ref<const std::string&>());
}

class DracoUnpacker {
 public:
  DracoUnpacker(Json& document, const DracoViews& views, std::uint64_t max_bytes)
      : document_(document), views_(views), max_(max_bytes), left_(max_bytes) {}

  proto::Expected<void> run(const std::stop_token& stop) {
    if (!document_.contains("meshes") || !document_.contains("accessors")) return {};
    for (std::size_t m = 0; m < document_["meshes"].size(); ++m) {
      const Json& primitives = document_["meshes"][m]["primitives"];
      for (std::size_t p = 0; p < primitives.size(); ++p) {
        const auto extensions = primitives[p].find("extensions");
        if (extensions == primitives[p].end() || !extensions->contains(kName)) continue;
        if (stop.stop_requested()) return exec::canceled();
        at_ = pointer_to(pointer_to("/meshes", m) + "/primitives", p) + "/extensions/" + kName;
        if (auto done = unpack(primitives[p], extensions->at(kName)); !done) return done;
      }
    }
    return {};
  }

 private:
  proto::Expected<void> wrong(const std::string& why) const { return invalid(why, at_); }
  static bool lacks_data(const Json& accessor) { return !accessor.contains("bufferView"); }
  static std::uint32_t component_type(const Json& accessor) {
    return std::uint32_t(count_at(accessor, "componentType", 0).value_or(0));
  }
  Json& accessor(const Json& index) { return document_["accessors"][*as_count(index)]; }

  /// The accessors of the primitive's attributes that have no data of their own, and what is to be
  /// decoded for them. Errors: `invalid_scene`.
  proto::Expected<std::vector<Json*>> lacking_accessors(const Json& attributes, const Json& ids,
                                                        DracoRequest& request) {
    std::vector<Json*> lacking;
    for (const auto& [name, index] : attributes.items()) {
      Json& to = accessor(index);
      if (name == "POSITION") request.vertices = count_at(to, "count", 0).value_or(0);
      const auto id = ids.find(name);
      if (id == ids.end() || !lacks_data(to)) continue;
      lacking.push_back(&to);
      request.attributes.push_back(
          {as_count(*id).value_or(~std::uint64_t{0}), component_type(to), components_of(to)});
      if (draco_stride(request.attributes.back()) == 0) return invalid("can't hold " + name, at_);
    }
    for (const Json* to : lacking)
      if (count_at(*to, "count", 0) != request.vertices)
        return invalid("its accessors differ in count", at_);
    return lacking;
  }

  proto::Expected<void> unpack(const Json& primitive, const Json& extension) {
    DracoRequest request;
    const auto lacking =
        lacking_accessors(primitive.at("attributes"), extension.at("attributes"), request);
    if (!lacking) return proto::Unexpected(lacking.error());
    Json* const indices = primitive.contains("indices") ? &accessor(primitive["indices"]) : nullptr;
    if (lacking->empty() && !(indices && lacks_data(*indices))) return {};
    if (count_at(primitive, "mode", 4) != 4)
      return proto::fail("unsupported_extension",
                         "a mesh that Draco compressed must consist of triangles", "scene", at_);
    if (!indices) return wrong("a compressed primitive needs indices");
    request.indices = count_at(*indices, "count", 0).value_or(0);
    request.index_type = component_type(*indices);
    if (auto fits = take_budget(request); !fits) return fits;
    const auto bytes = views_.bytes(std::size_t(*as_count(extension.at("bufferView"))));
    if (!bytes) return wrong("its buffer view has no data");
    auto mesh = decode_draco(*bytes, request);
    if (!mesh) return wrong(mesh.error().message);
    for (std::size_t i = 0; i < lacking->size(); ++i)
      give(*(*lacking)[i], std::move(mesh->attributes[i]), draco_stride(request.attributes[i]));
    if (lacks_data(*indices)) give(*indices, std::move(mesh->indices), 0);
    return {};
  }

  void give(Json& accessor, std::string bytes, std::uint32_t stride) {
    accessor["bufferView"] = views_.add(std::move(bytes), stride);
    accessor.erase("byteOffset");
  }

  proto::Expected<void> take_budget(const DracoRequest& request) {
    std::uint64_t bytes = 4;
    for (const DracoAttribute& a : request.attributes) bytes += draco_stride(a);
    // Floating point is needed, since a count may be any number.
    const double wanted = double(bytes) * double(request.vertices) + 4.0 * double(request.indices);
    if (wanted > double(left_))
      return over_limit("too much data once it is decompressed", max_, "upload_bytes", at_);
    left_ -= std::uint64_t(wanted);
    return {};
  }

  Json& document_;
  const DracoViews& views_;
  const std::uint64_t max_;
  std::uint64_t left_;
  std::string at_;  ///< pointer to the extension under work
};

}  // namespace

proto::Expected<void> unpack_draco(Json& document, const DracoViews& views, std::uint64_t max_bytes,
                                   const std::stop_token& stop) {
  return DracoUnpacker(document, views, max_bytes).run(stop);
}

}  // namespace kiln::gltf
