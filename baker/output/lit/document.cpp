#include "baker/output/lit/document.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "baker/gltf/container.h"
#include "baker/gltf/draco_document.h"
#include "baker/gltf/meshopt_decoder.h"
#include "baker/gltf/uri.h"
#include "proto/files.h"

namespace kiln::output::lit {
namespace {

using proto::Expected;
using proto::Unexpected;

/// In a buffer view.
constexpr const char* kMeshopt = "/extensions/EXT_meshopt_compression";

/// Media type by the first bytes; "" when unknown.
std::string sniff_image(std::string_view bytes) {
  if (bytes.starts_with("\x89PNG")) return "image/png";
  if (bytes.starts_with("\xFF\xD8\xFF")) return "image/jpeg";
  if (bytes.starts_with("RIFF") && bytes.size() > 12 && bytes.substr(8, 4) == "WEBP")
    return "image/webp";
  if (bytes.starts_with("\xABKTX 20")) return "image/ktx2";
  return "";
}

std::string u32_bytes(std::uint64_t value) {
  std::string out;
  for (int i = 0; i < 4; ++i) out += static_cast<char>(value >> (8 * i) & 0xFF);
  return out;
}

}  // namespace

LitDocument::LitDocument(const files::SceneFiles& files) : files_(files) {}
LitDocument::~LitDocument() = default;

proto::Expected<std::unique_ptr<LitDocument>> LitDocument::open(const files::SceneFiles& files) {
  std::unique_ptr<LitDocument> doc(new LitDocument(files));
  auto file = map_file(files, files.main, files::MappedFile::kAnyLength);
  if (!file) return Unexpected(file.error());
  const auto container = gltf::open_container(doc->mapped_.emplace_back(std::move(*file)).bytes());
  if (!container) return Unexpected(container.error());
  doc->json_ = std::make_unique<Json>(Json::parse(container->json, nullptr, false));
  if (!doc->json_->is_object())
    return proto::fail("invalid_scene", "not a JSON object", "scene", "");
  // An object's members move when it gains one: no loop over another member may add this one.
  if (!doc->json().contains("bufferViews")) doc->json()["bufferViews"] = Json::array();
  if (auto ok = doc->load_buffers(container->binary); !ok) return Unexpected(ok.error());
  if (auto ok = doc->load_views(); !ok) return Unexpected(ok.error());
  doc->merge_buffers();
  if (auto ok = doc->unpack_meshes(); !ok) return Unexpected(ok.error());
  doc->embed_images();
  return doc;
}

proto::Expected<void> LitDocument::load_buffers(std::optional<std::string_view> binary) {
  const Json& buffers = json().value("buffers", Json::array());
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    const std::string at = "/buffers/" + std::to_string(i);
    const auto length = count_at(buffers[i], "byteLength", 0);
    std::optional<std::string_view> bytes;
    if (i == 0) bytes = binary;
    const std::string uri = buffers[i].value("uri", "");
    if (gltf::is_data_uri(uri)) {
      auto data = gltf::decode_data_uri(uri, at + "/uri");
      if (!data) return Unexpected(data.error());
      bytes = decoded_.emplace_back(std::move(data->bytes));
    } else if (!uri.empty()) {
      const auto path = gltf::find_side_file(files_, uri, at + "/uri");
      if (!path) return Unexpected(path.error());
      auto file = map_file(files_, *path, files::MappedFile::kAnyLength);
      if (!file) return Unexpected(file.error());
      bytes = mapped_.emplace_back(std::move(*file)).bytes();
    }
    if (!length || (bytes && bytes->size() < *length))
      return proto::fail("invalid_scene", "byteLength does not fit the data", "scene", at);
    if (bytes) bytes = bytes->substr(0, *length);
    buffers_.push_back(bytes);
  }
  return {};
}

proto::Expected<void> LitDocument::load_views() {
  const Json& views = json().value("bufferViews", Json::array());
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto buffer = count_at(views[i], "buffer", std::numeric_limits<std::uint64_t>::max());
    const auto offset = count_at(views[i], "byteOffset", 0);
    const auto length = count_at(views[i], "byteLength", 0);
    if (!buffer || *buffer >= buffers_.size() || !offset || !length)
      return proto::fail("invalid_scene", "not a buffer view", "scene",
                         "/bufferViews/" + std::to_string(i));
    const auto& data = buffers_[*buffer];
    if (data && (*offset > data->size() || *length > data->size() - *offset))
      return proto::fail("invalid_scene", "reaches beyond its buffer", "scene",
                         "/bufferViews/" + std::to_string(i));
    views_.push_back(data ? std::optional(data->substr(*offset, *length)) : unpack(views[i]));
  }
  return {};
}

/// What a view with EXT_meshopt_compression holds; nothing for others, and for what no import
/// reads.
std::optional<std::string_view> LitDocument::unpack(const Json& view) {
  const Json::json_pointer packed(kMeshopt);
  if (!view.contains(packed) || !view[packed].is_object()) return std::nullopt;
  const Json& from = view[packed];
  const auto number = [&](const Json& object, const char* key) {
    return count_at(object, key, 0).value_or(0);
  };
  const auto buffer = count_at(from, "buffer", buffers_.size()).value_or(buffers_.size());
  if (buffer >= buffers_.size() || !buffers_[buffer]) return std::nullopt;
  const auto offset = number(from, "byteOffset"), length = number(from, "byteLength");
  const std::string_view data = *buffers_[buffer];
  if (offset > data.size() || length > data.size() - offset) return std::nullopt;
  const gltf::MeshoptView spec{number(from, "count"), number(from, "byteStride"),
                               from.value("mode", std::string()),
                               from.value("filter", std::string("NONE"))};
  if (!wrong_with(spec, length, number(view, "byteLength"), number(view, "byteStride")).empty())
    return std::nullopt;
  std::string& plain = decoded_.emplace_back();
  if (!decode_meshopt(spec, data.substr(offset, length), plain).empty()) return std::nullopt;
  return plain;
}

/// All data goes into buffer 0; a buffer without data (a fallback that nobody reads) stays a
/// buffer.
void LitDocument::merge_buffers() {
  Json merged = Json::array({Json::object()});
  std::vector<std::pair<std::size_t, std::uint64_t>> place(buffers_.size());  // new buffer, base
  for (std::size_t i = 0; i < buffers_.size(); ++i) {
    Json buffer = json()["buffers"][i];
    if (!buffers_[i]) {
      place[i] = {merged.size(), 0};
      merged.push_back(std::move(buffer));
      continue;
    }
    place[i] = {0, binary_.append_view(*buffers_[i])};
    buffer.erase("uri");
    if (i == 0) merged[0] = std::move(buffer);
  }
  const auto move_view = [&](Json& view) {
    const auto buffer = count_at(view, "buffer", 0);
    const auto offset = count_at(view, "byteOffset", 0);
    if (!buffer || *buffer >= place.size() || !offset) return;
    const auto [target, base] = place[*buffer];
    view["buffer"] = target;
    if (*offset + base != 0 || view.contains("byteOffset")) view["byteOffset"] = *offset + base;
  };
  if (json().contains("bufferViews"))
    for (Json& view : json()["bufferViews"]) {
      move_view(view);
      const Json::json_pointer packed(kMeshopt);
      if (view.contains(packed) && view[packed].is_object()) move_view(view[packed]);
    }
  json()["buffers"] = std::move(merged);
}

/// Meshes that KHR_draco_mesh_compression holds become plain, see DracoUnpacker.
Expected<void> LitDocument::unpack_meshes() {
  const auto bytes = [&](std::size_t i) -> std::optional<std::string_view> {
    return i < views_.size() ? views_[i] : std::nullopt;
  };
  const auto add = [&](std::string plain, std::uint32_t stride) {
    views_.push_back(decoded_.emplace_back(std::move(plain)));
    Json view = {{"buffer", 0},
                 {"byteOffset", binary_.append_view(*views_.back())},
                 {"byteLength", views_.back()->size()}};
    if (stride > 0) view["byteStride"] = stride;
    return std::size_t{this->add("bufferViews", std::move(view))};
  };
  return gltf::DracoUnpacker<Json>(json(), {bytes, add}, std::numeric_limits<std::uint64_t>::max())
      .run();
}

Json& extensions_of(Json& object) {
  Json& extensions = object["extensions"];
  if (!extensions.is_object()) extensions = Json::object();
  return extensions;
}

std::optional<std::string> LitDocument::image_bytes(const std::string& uri) const {
  if (gltf::is_data_uri(uri)) {
    auto data = gltf::decode_data_uri(uri, "");
    return data ? std::optional(std::move(data->bytes)) : std::nullopt;
  }
  const auto path = gltf::find_side_file(files_, uri, "");
  if (!path) return std::nullopt;
  const auto file = map_file(files_, *path, files::MappedFile::kAnyLength);
  return file ? std::optional(std::string(file->bytes())) : std::nullopt;
}

/// Whether the document may hold images of that type: core glTF knows two, extensions add theirs.
bool LitDocument::allows_image(const std::string& media_type) const {
  if (media_type == "image/png" || media_type == "image/jpeg") return true;
  const char* extension = media_type == "image/webp"   ? "EXT_texture_webp"
                          : media_type == "image/ktx2" ? "KHR_texture_basisu"
                                                       : "";
  const Json used = json_->value("extensionsUsed", Json::array());
  return std::find(used.begin(), used.end(), extension) != used.end();
}

/// An image that was not uploaded, or of a type that the document may not hold, keeps its URI.
void LitDocument::embed_images() {
  if (!json().contains("images") || !json()["images"].is_array()) return;
  for (Json& image : json()["images"]) {
    if (!image.is_object() || !image.contains("uri") || !image["uri"].is_string()) continue;
    auto bytes = image_bytes(image["uri"].get<std::string>());
    if (!bytes) continue;
    const std::string kind = sniff_image(*bytes);
    if (!allows_image(kind)) continue;
    image.erase("uri");
    image["mimeType"] = kind;
    image["bufferView"] = add_view(std::move(*bytes));
  }
}

std::uint32_t LitDocument::add(const char* collection, Json item) {
  Json& items = json()[collection];
  if (!items.is_array()) items = Json::array();
  items.push_back(std::move(item));
  return static_cast<std::uint32_t>(items.size() - 1);
}

std::uint32_t LitDocument::add_view(std::string bytes, int target, std::uint32_t stride) {
  Json view = {{"buffer", 0}, {"byteOffset", 0}, {"byteLength", bytes.size()}};
  view["byteOffset"] = binary_.append(std::move(bytes));
  if (stride) view["byteStride"] = stride;
  if (target) view["target"] = target;
  return add("bufferViews", std::move(view));
}

proto::Expected<void> LitDocument::write(int fd) {
  json()["buffers"][0]["byteLength"] = binary_.size();
  std::string text = json().dump();
  text.append((4 - text.size() % 4) % 4, ' ');
  const std::uint64_t total = 12 + 8 + text.size() + 8 + binary_.size();
  if (total > gltf::kMaxGlbBytes)
    return proto::fail("limit_exceeded", "lit.glb would be longer than the 4 GiB of its format");

  const std::string head = std::string("glTF") + u32_bytes(2) + u32_bytes(total) +
                           u32_bytes(text.size()) + "JSON" + std::move(text) +
                           u32_bytes(binary_.size()) + std::string("BIN\0", 4);
  if (auto ok = proto::write_all(fd, head, "lit.glb"); !ok) return ok;
  for (const std::string_view piece : binary_.pieces())
    if (auto ok = proto::write_all(fd, piece, "lit.glb"); !ok) return ok;
  return {};
}

}  // namespace kiln::output::lit
