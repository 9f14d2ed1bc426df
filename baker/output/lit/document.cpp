#include "baker/output/lit/document.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "baker/gltf/container.h"
#include "baker/gltf/uri.h"
#include "proto/files.h"

namespace kiln::output::lit {
namespace {

using proto::Expected;
using proto::Unexpected;

/// The place of a packed view's numbers in a buffer view.
constexpr const char* kMeshopt = "/extensions/EXT_meshopt_compression";

/// Returns the media type by the first bytes; "" when it is unknown.
std::string sniff_image(std::string_view bytes) {
  if (bytes.starts_with("\x89PNG")) return "image/png";
  if (bytes.starts_with("\xFF\xD8\xFF")) return "image/jpeg";
  if (bytes.starts_with("RIFF") && bytes.size() > 12 && bytes.substr(8, 4) == "WEBP")
    return "image/webp";
  if (bytes.starts_with("\xABKTX 20")) return "image/ktx2";
  return "";
}

}  // namespace

LitDocument::LitDocument(gltf::Document source, files::SceneFiles files)
    : source_(std::move(source)), accessors_(source_, {}), files_(std::move(files)) {}
LitDocument::~LitDocument() = default;

proto::Expected<std::unique_ptr<LitDocument>> LitDocument::open(const files::SceneFiles& files,
                                                                const files::ImportLimits& limits) {
  auto source = gltf::open_document(files, limits, {}, gltf::Keep::kEverything);
  if (!source) return Unexpected(source.error());
  std::unique_ptr<LitDocument> doc(new LitDocument(std::move(*source), files));
  // An object's members move when it gains one: no loop over another member may add this one.
  if (!doc->json().contains("bufferViews")) doc->json()["bufferViews"] = Json::array();
  doc->merge_buffers();
  doc->append_unpacked_views();
  doc->embed_images();
  return doc;
}

/// Moves all data into buffer 0. A buffer without data, a fallback that no reader uses, stays a
/// buffer.
void LitDocument::merge_buffers() {
  const auto& buffers = source_.buffers;
  Json merged = Json::array({Json::object()});
  std::vector<std::pair<std::size_t, std::uint64_t>> place(buffers.size());  // new buffer, base
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    Json buffer = json()["buffers"][i];
    if (!buffers[i]) {
      place[i] = {merged.size(), 0};
      merged.push_back(std::move(buffer));
      continue;
    }
    place[i] = {0, binary_.append_view(*buffers[i])};
    buffer.erase("uri");
    if (i == 0) merged[0] = std::move(buffer);
  }
  const auto move_view = [&](Json& view) {
    const auto [target, base] = place[*count_at(view, "buffer", 0)];
    const std::uint64_t offset = *count_at(view, "byteOffset", 0);
    view["buffer"] = target;
    if (offset + base != 0 || view.contains("byteOffset")) view["byteOffset"] = offset + base;
  };
  for (std::size_t i = 0; i < source_.source_views; ++i) {
    Json& view = json()["bufferViews"][i];
    move_view(view);
    const Json::json_pointer packed(kMeshopt);
    if (view.contains(packed)) move_view(view[packed]);
  }
  json()["buffers"] = std::move(merged);
}

/// Puts the contents of the meshes that were unpacked behind the source's data.
void LitDocument::append_unpacked_views() {
  Json& views = json()["bufferViews"];
  for (std::size_t i = source_.source_views; i < views.size(); ++i)
    views[i]["byteOffset"] = binary_.append_view(*source_.unpacked_views[i]);
}

Json& extensions_of(Json& object) {
  Json& extensions = object["extensions"];
  if (!extensions.is_object()) extensions = Json::object();
  return extensions;
}

void drop_extension(Json& object, const char* name) {
  const auto extensions = object.find("extensions");
  if (extensions == object.end() || !extensions->is_object()) return;
  extensions->erase(name);
  if (extensions->empty()) object.erase("extensions");
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

/// Says whether the document may hold images of that type: core glTF knows two, extensions add
/// theirs.
bool LitDocument::allows_image(const std::string& media_type) const {
  if (media_type == "image/png" || media_type == "image/jpeg") return true;
  const char* extension = media_type == "image/webp"   ? "EXT_texture_webp"
                          : media_type == "image/ktx2" ? "KHR_texture_basisu"
                                                       : "";
  const Json& used = gltf::collection(*source_.json, "extensionsUsed");
  return std::find(used.begin(), used.end(), extension) != used.end();
}

/// An image that was not uploaded, or of a type that the document may not hold, keeps its URI.
void LitDocument::embed_images() {
  if (!json().contains("images")) return;
  for (Json& image : json()["images"]) {
    if (!image.contains("uri")) continue;
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

proto::Expected<gltf::AccessorView> LitDocument::accessor(std::uint64_t index) const {
  return accessors_.open_raw(index);
}

proto::Expected<void> LitDocument::write(int fd) {
  json()["buffers"][0]["byteLength"] = binary_.size();
  std::string text = json().dump();
  if (gltf::glb_bytes(text.size(), binary_.size()) > gltf::kMaxGlbBytes)
    return proto::fail("limit_exceeded", "lit.glb would be longer than the 4 GiB of its format.");
  const std::string head = gltf::glb_head(std::move(text), binary_.size());
  if (auto ok = proto::write_all(fd, head, "lit.glb"); !ok) return ok;
  for (const std::string_view piece : binary_.pieces())
    if (auto ok = proto::write_all(fd, piece, "lit.glb"); !ok) return ok;
  return {};
}

}  // namespace kiln::output::lit
