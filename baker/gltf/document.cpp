#include "baker/gltf/document.h"

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "baker/exec/stop.h"
#include "baker/gltf/accessors.h"
#include "baker/gltf/container.h"
#include "baker/gltf/draco.h"
#include "baker/gltf/extensions.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/meshopt.h"
#include "baker/gltf/model.h"
#include "baker/gltf/tinygltf.h"
#include "baker/gltf/uri.h"

namespace kiln::gltf {
namespace {

constexpr const char* kMeshoptName = "EXT_meshopt_compression";

using proto::Expected;
using proto::Unexpected;

/// "2.0" as {2, 0}; nothing for other texts.
std::optional<std::pair<int, int>> parse_version(const std::string& text) {
  int major = 0, minor = 0, used = 0;
  if (text.size() > 8 || std::sscanf(text.c_str(), "%d.%d%n", &major, &minor, &used) != 2 ||
      used != static_cast<int>(text.size())) {
    return std::nullopt;
  }
  return std::pair{major, minor};
}

proto::Expected<void> check_version(const Json& asset) {
  const auto version = parse_version(asset.at("version").get<std::string>());
  if (!version || version->first != 2)
    return invalid("expected glTF version 2.x", "/asset/version");
  if (!asset.contains("minVersion")) return {};
  const auto least = parse_version(asset.at("minVersion").get<std::string>());
  if (!least || *least > std::pair{2, 0} || *least > *version) {
    return invalid("the scene needs a newer glTF than 2.0", "/asset/minVersion");
  }
  return {};
}

/// Returns the bytes of one buffer; nothing for one that neither has a URI nor is the .glb's own.
Expected<std::optional<std::string_view>> buffer_bytes(Document& document, const Json& buffer,
                                                       std::size_t index,
                                                       const Container& container) {
  const std::string at = pointer_to("/buffers", index);
  if (!buffer.contains("uri")) {
    return index == 0 ? container.binary : std::optional<std::string_view>();
  }
  const auto& uri = buffer.at("uri").get_ref<const std::string&>();
  if (!is_data_uri(uri)) {
    const auto file = document.files.side_file(uri, at + "/uri");
    if (!file) return Unexpected(file.error());
    return std::optional(*file);
  }
  auto data = decode_data_uri(uri, at + "/uri");
  if (!data) return Unexpected(data.error());
  document.decoded.push_back(std::make_unique<std::string>(std::move(data->bytes)));
  return std::optional<std::string_view>(*document.decoded.back());
}

proto::Expected<void> load_buffers(Document& document, const Json& buffers,
                                   const Container& container, const std::stop_token& stop) {
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    if (stop.stop_requested()) return exec::canceled();
    const auto bytes = buffer_bytes(document, buffers[i], i, container);
    if (!bytes) return Unexpected(bytes.error());
    const auto length = buffers[i].at("byteLength").get<std::uint64_t>();
    if (*bytes && (*bytes)->size() < length) {
      return invalid("expects " + std::to_string(length) + " bytes, but its data has " +
                         std::to_string((*bytes)->size()),
                     pointer_to("/buffers", i) + "/byteLength");
    }
    document.buffers.push_back(*bytes ? std::optional((*bytes)->substr(0, length)) : std::nullopt);
  }
  return {};
}

/// Decodes the views with EXT_meshopt_compression whose buffer has no plain data.
Expected<void> unpack_views(Document& document, const Json& views,
                            const files::ImportLimits& limits, const std::stop_token& stop) {
  std::uint64_t left = limits.file_bytes;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto extensions = views[i].find("extensions");
    if (extensions == views[i].end() || !extensions->contains(kMeshoptName)) continue;
    if (document.buffers[views[i].at("buffer").get<std::size_t>()]) continue;
    if (stop.stop_requested()) return exec::canceled();
    const std::string at = pointer_to("/bufferViews", i) + "/extensions/" + kMeshoptName;
    const Json& from = extensions->at(kMeshoptName);
    const auto& buffer = document.buffers[from.at("buffer").get<std::size_t>()];
    const auto offset = from.value("byteOffset", std::uint64_t{0}),
               length = from.at("byteLength").get<std::uint64_t>();
    if (!buffer) return invalid("its buffer has no data", at);
    if (offset > buffer->size() || length > buffer->size() - offset)
      return invalid("reaches beyond its buffer of " + std::to_string(buffer->size()) + " bytes",
                     at);
    const MeshoptView view{from.at("count").get<std::uint64_t>(),
                           from.at("byteStride").get<std::uint64_t>(),
                           from.at("mode").get<std::string>(), from.value("filter", "NONE")};
    const auto plain = views[i].at("byteLength").get<std::uint64_t>();
    if (auto why = wrong_with(view, length, plain, views[i].value("byteStride", std::uint64_t{0}));
        !why.empty())
      return invalid(why, at);
    if (plain > left)
      return over_limit("too much data once it is decompressed", limits.file_bytes, "upload_bytes",
                        at);
    left -= plain;
    auto bytes = std::make_unique<std::string>();
    if (auto why = decode_meshopt(view, buffer->substr(offset, length), *bytes); !why.empty())
      return invalid(why, at);
    document.unpacked_views.resize(views.size());
    document.unpacked_views[i] = *bytes;
    document.decoded.push_back(std::move(bytes));
  }
  return {};
}

/// Returns the bytes of a view of a document that was not read into the library yet.
std::optional<std::string_view> view_bytes(const Document& document, const Json& view,
                                           std::size_t index) {
  const auto& unpacked = document.unpacked_views;
  if (index < unpacked.size() && unpacked[index]) return unpacked[index];
  const auto& buffer = document.buffers[view.at("buffer").get<std::size_t>()];
  const auto offset = view.value("byteOffset", std::uint64_t{0}),
             length = view.at("byteLength").get<std::uint64_t>();
  if (!buffer || offset > buffer->size() || length > buffer->size() - offset) return std::nullopt;
  return buffer->substr(offset, length);
}

/// Decodes the meshes that KHR_draco_mesh_compression holds; new views take their contents.
Expected<void> unpack_meshes(Document& document, Json& parsed, const files::ImportLimits& limits,
                             const std::stop_token& stop) {
  if (!parsed.contains("bufferViews")) return {};
  Json& views = parsed["bufferViews"];
  const auto bytes = [&](std::size_t i) { return view_bytes(document, views[i], i); };
  const auto add = [&](std::string plain, std::uint32_t stride) {
    Json view = {{"buffer", 0u}, {"byteOffset", 0u}, {"byteLength", plain.size()}};
    if (stride > 0) view["byteStride"] = stride;
    document.decoded.push_back(std::make_unique<std::string>(std::move(plain)));
    views.push_back(std::move(view));
    document.unpacked_views.resize(views.size());
    document.unpacked_views.back() = *document.decoded.back();
    return views.size() - 1;
  };
  return unpack_draco(parsed, {bytes, add}, limits.file_bytes, stop);
}

/// Gives the model the views that unpack_meshes() added to the parsed document.
void add_unpacked_views(tinygltf::Model& model, const Json& parsed) {
  if (!parsed.contains("bufferViews")) return;
  const Json& views = parsed.at("bufferViews");
  for (std::size_t i = model.bufferViews.size(); i < views.size(); ++i) {
    tinygltf::BufferView& view = model.bufferViews.emplace_back();
    view.buffer = 0;
    view.byteLength = views[i].at("byteLength").get<std::size_t>();
    view.byteStride = views[i].value("byteStride", std::size_t{0});
  }
}

proto::Expected<void> check_buffer_views(const Document& document, const Json& buffers) {
  const tinygltf::Model& model = *document.model;
  for (std::size_t i = 0; i < model.bufferViews.size(); ++i) {
    const auto& view = model.bufferViews[i];
    if (i < document.unpacked_views.size() && document.unpacked_views[i]) continue;
    const auto length =
        buffers[static_cast<std::size_t>(view.buffer)].at("byteLength").get<std::uint64_t>();
    if (view.byteOffset > length || view.byteLength > length - view.byteOffset) {
      return invalid("reaches beyond its buffer of " + std::to_string(length) + " bytes",
                     pointer_to("/bufferViews", i));
    }
    if (view.byteStride % 4 != 0) {
      return invalid("expected a multiple of 4", pointer_to("/bufferViews", i) + "/byteStride");
    }
  }
  return {};
}

void read_images(Document& document, const Json& images) {
  for (const Json& image : images) {
    document.images.push_back(
        {image.value("uri", ""), image.value("mimeType", ""), image.value("bufferView", -1)});
  }
}

void read_cameras(Document& document, const Json& cameras) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  const auto number = [&](const Json& camera, const char* kind, const char* name) {
    const auto found = camera.find(kind);
    return found == camera.end() ? kUnknown : found->value(name, kUnknown);
  };
  for (const Json& camera : cameras) {
    const std::string type = camera.value("type", "");
    CameraSource& out = document.cameras.emplace_back();
    out.name = camera.value("name", "");
    out.orthographic = type == "orthographic";
    out.half_height = out.orthographic        ? number(camera, "orthographic", "ymag")
                      : type == "perspective" ? std::tan(number(camera, "perspective", "yfov") / 2)
                                              : kUnknown;
  }
}

/// Refuses indices without data, which the library refuses without saying where they are.
Expected<void> check_index_accessors(const Json& document, const std::stop_token& stop) {
  if (!document.contains("meshes") || !document.contains("accessors")) return {};
  const Json& accessors = document.at("accessors");
  exec::StopPoll stopped(stop);
  for (const Json& mesh : document.at("meshes")) {
    if (stopped()) return exec::canceled();
    for (const Json& primitive : mesh.at("primitives")) {
      if (!primitive.contains("indices")) continue;
      const auto index = primitive.at("indices").get<std::size_t>();
      if (!accessors[index].contains("bufferView")) {
        return invalid("indices without a buffer view draw nothing",
                       pointer_to("/accessors", index));
      }
    }
  }
  return {};
}

/// Reads the JSON text into `model`, and beside it all that the library must not see.
Expected<void> read_document(Document& document, const Container& container,
                             const files::ImportLimits& limits, Keep keep,
                             const std::stop_token& stop) {
  auto read = parse_gltf_json(container.json, limits.json_depth, keep, stop);
  if (!read) return Unexpected(read.error());
  Json& parsed = *read->document;
  if (auto known = check_required_extensions(parsed); !known) return known;
  if (auto checked = check_gltf(parsed, stop); !checked) return checked;
  if (auto version = check_version(parsed.at("asset")); !version) return version;
  if (collection(parsed, "nodes").size() > limits.nodes)
    return over_limit("too many nodes", limits.nodes, "nodes", "/nodes");
  const Json& buffers = collection(parsed, "buffers");
  document.source_views = collection(parsed, "bufferViews").size();
  read_images(document, collection(parsed, "images"));
  read_cameras(document, collection(parsed, "cameras"));
  document.has_animations = !collection(parsed, "animations").empty();
  if (auto loaded = load_buffers(document, buffers, container, stop); !loaded) return loaded;
  if (auto unpacked = unpack_views(document, collection(parsed, "bufferViews"), limits, stop);
      !unpacked)
    return unpacked;
  if (auto unpacked = unpack_meshes(document, parsed, limits, stop); !unpacked) return unpacked;
  if (auto usable = check_index_accessors(parsed, stop); !usable) return usable;
  if (auto model = read_model(*document.model, *read, stop); !model) return model;
  add_unpacked_views(*document.model, parsed);
  if (auto checked = check_buffer_views(document, buffers); !checked) return checked;
  if (keep == Keep::kEverything) document.json = std::move(read->document);
  return {};
}

}  // namespace

proto::Expected<std::string_view> FileCache::load(const std::filesystem::path& path,
                                                  const std::string& pointer, const char* where) {
  if (const auto known = mapped_.find(path); known != mapped_.end()) return known->second.bytes();
  auto file = map_file(files_, path, left_);
  if (!file) {
    file.error().details = {{where, pointer, file.error().message}};
    return Unexpected(file.error());
  }
  left_ -= file->bytes().size();
  return mapped_.emplace(path, std::move(*file)).first->second.bytes();
}

proto::Expected<std::string_view> FileCache::main_file() {
  return load(files_.main, "");
}

proto::Expected<std::filesystem::path> FileCache::find(const std::string& uri,
                                                       const std::string& pointer) const {
  return find_side_file(files_, uri, pointer);
}

proto::Expected<std::string_view> FileCache::side_file(const std::string& uri,
                                                       const std::string& pointer) {
  const auto path = find(uri, pointer);
  if (!path) return Unexpected(path.error());
  return load(*path, pointer);
}

proto::Expected<std::string_view> FileCache::named_file(const std::string& name, const char* where,
                                                        const std::string& pointer) {
  const auto path = find_named_file(files_, name, where, pointer);
  if (!path) return Unexpected(path.error());
  return load(*path, pointer, where);
}

Document::Document(const files::SceneFiles& scene_files, const files::ImportLimits& limits)
    : model(std::make_unique<tinygltf::Model>()), files(scene_files, limits.file_bytes) {}
Document::Document(Document&&) noexcept = default;
Document::~Document() = default;

proto::Expected<Document> open_document(const files::SceneFiles& files,
                                        const files::ImportLimits& limits, std::stop_token stop,
                                        Keep keep) {
  Document document(files, limits);
  const auto bytes = document.files.main_file();
  if (!bytes) return Unexpected(bytes.error());
  const auto container = open_container(*bytes);
  if (!container) return Unexpected(container.error());
  if (container->json.size() > limits.json_bytes) {
    return over_limit("the JSON is too long", limits.json_bytes, "scene_json_bytes", "");
  }
  if (auto read = read_document(document, *container, limits, keep, stop); !read) {
    return Unexpected(read.error());
  }
  if (auto checked = check_accessors(document, stop); !checked) return Unexpected(checked.error());
  warn_of_extensions(document);
  return document;
}

proto::Expected<std::string_view> buffer_view_bytes(const Document& document, int view,
                                                    const std::string& pointer) {
  const auto index = static_cast<std::size_t>(view);
  if (index < document.unpacked_views.size() && document.unpacked_views[index])
    return *document.unpacked_views[index];
  const auto& v = document.model->bufferViews[index];
  const auto& buffer = document.buffers[static_cast<std::size_t>(v.buffer)];
  if (!buffer) return invalid("its buffer has no data", pointer);
  return buffer->substr(v.byteOffset, v.byteLength);
}

Needs find_needs(std::string_view bytes, const files::ImportLimits& limits) {
  const auto container = open_container(bytes);
  if (!container || container->json.size() > limits.json_bytes) return {};
  const auto read = parse_gltf_json(container->json, limits.json_depth, Keep::kWhatABakeReads, {});
  if (!read) return {};
  Needs needs;
  needs.images = !collection(*read->document, "images").empty();
  for (const char* list : {"buffers", "images"}) {
    for (const Json& item : collection(*read->document, list)) {
      if (!item.is_object() || !item.contains("uri") || !item["uri"].is_string()) continue;
      auto name = relative_file_name(item["uri"].get_ref<const std::string&>(), "");
      if (name) needs.side_files.push_back(std::move(*name));
    }
  }
  return needs;
}

}  // namespace kiln::gltf
