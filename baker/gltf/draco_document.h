#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/gltf/draco_decoder.h"
#include "baker/gltf/errors.h"
#include "baker/gltf/json.h"

namespace kiln::gltf {

/// What is behind a document's buffer views, and where new ones go.
struct DracoViews {
  std::function<std::optional<std::string_view>(std::size_t view)> bytes;
  /// Takes the bytes of a new one, with a stride unless that is 0; returns its index.
  std::function<std::size_t(std::string bytes, std::uint32_t stride)> add;
};

/// Gives the accessors that have their data in KHR_draco_mesh_compression alone plain buffer views:
/// the document then reads as if it had never been compressed. The extensions stay where they are.
/// For any kind of nlohmann's JSON, since both the import and lit.glb do this.
template <class Json>
class DracoUnpacker {
 public:
  DracoUnpacker(Json& document, DracoViews views, std::uint64_t max_bytes)
      : document_(document), views_(std::move(views)), max_(max_bytes), left_(max_bytes) {}

  /// Errors: `invalid_scene`, `unsupported_extension` (triangle strips), `limit_exceeded` (more
  /// than `max_bytes` of plain data), `canceled`.
  proto::Expected<void> run(const std::stop_token& stop = {}) {
    if (!document_.contains("meshes") || !document_.contains("accessors")) return {};
    for (std::size_t m = 0; m < document_["meshes"].size(); ++m) {
      Json& primitives = document_["meshes"][m]["primitives"];
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
  static constexpr const char* kName = "KHR_draco_mesh_compression";

  static std::optional<std::uint64_t> whole(const Json& object, const char* key) {
    const auto value = object.find(key);
    if (value == object.end() || !value->is_number()) return std::nullopt;
    const double v = value->template get<double>();
    if (!(v >= 0) || v > 0x1p53 || v != double(std::uint64_t(v))) return std::nullopt;
    return std::uint64_t(v);
  }
  proto::Expected<void> wrong(const std::string& why) const { return invalid(why, at_); }

  /// An accessor that the document has; null when the index is none.
  Json* accessor(const Json& index) {
    if (!index.is_number_integer()) return nullptr;
    const auto i = index.template get<std::int64_t>();
    Json& all = document_["accessors"];
    return i >= 0 && std::size_t(i) < all.size() ? &all[std::size_t(i)] : nullptr;
  }
  static bool lacks_data(const Json& accessor) { return !accessor.contains("bufferView"); }

  proto::Expected<void> unpack(const Json& primitive, const Json& extension) {
    const Json none = Json::object();
    const Json& ids = extension.contains("attributes") ? extension["attributes"] : none;
    const Json& attributes = primitive.contains("attributes") ? primitive["attributes"] : none;
    DracoRequest request;
    std::vector<Json*> lacking;
    for (const auto& [name, index] : attributes.items()) {
      Json* const to = accessor(index);
      if (!to) return wrong("an attribute has no accessor");
      const auto count = whole(*to, "count"), type = whole(*to, "componentType");
      const auto id = whole(ids, name.c_str());
      if (name == "POSITION") request.vertices = count.value_or(0);
      if (!id || !lacks_data(*to)) continue;
      lacking.push_back(to);
      request.attributes.push_back(
          {*id, std::uint32_t(type.value_or(0)), components(to->value("type", std::string()))});
      if (draco_stride(request.attributes.back()) == 0) return wrong("can't hold " + name);
    }
    for (const Json* to : lacking)
      if (whole(*to, "count") != request.vertices) return wrong("its accessors differ in count");
    Json* const indices = primitive.contains("indices") ? accessor(primitive["indices"]) : nullptr;
    if (lacking.empty() && !(indices && lacks_data(*indices))) return {};
    if (whole(primitive, "mode").value_or(4) != 4)
      return proto::fail("unsupported_extension",
                         "of what Draco compresses only triangles are read", "scene", at_);
    if (!indices) return wrong("a compressed primitive needs indices");
    request.indices = whole(*indices, "count").value_or(0);
    request.index_type = std::uint32_t(whole(*indices, "componentType").value_or(0));
    if (auto fits = take_budget(request); !fits) return fits;
    const auto view = whole(extension, "bufferView");
    const auto bytes = view ? views_.bytes(std::size_t(*view)) : std::nullopt;
    if (!bytes) return wrong("its buffer view has no data");
    auto mesh = decode_draco(*bytes, request);
    if (!mesh) return wrong(mesh.error().message);
    for (std::size_t i = 0; i < lacking.size(); ++i)
      give(*lacking[i], std::move(mesh->attributes[i]), draco_stride(request.attributes[i]));
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
    // In floating point, since a count may be any number.
    const double wanted = double(bytes) * double(request.vertices) + 4.0 * double(request.indices);
    if (wanted > double(left_))
      return over_limit("too much data once it is decompressed", max_, "upload_bytes", at_);
    left_ -= std::uint64_t(wanted);
    return {};
  }

  static std::uint32_t components(const std::string& type) {
    if (type == "SCALAR") return 1;
    return type.size() == 4 && type.starts_with("VEC") ? std::uint32_t(type[3] - '0') : 0;
  }

  Json& document_;
  const DracoViews views_;
  const std::uint64_t max_;
  std::uint64_t left_;
  std::string at_;  ///< pointer to the extension under work
};

}  // namespace kiln::gltf
