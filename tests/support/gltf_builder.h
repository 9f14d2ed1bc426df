#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace kiln::test {

/// glTF component type of a C++ type.
template <class T>
constexpr int component_type() {
  if constexpr (std::is_same_v<T, std::int8_t>) return 5120;
  if constexpr (std::is_same_v<T, std::uint8_t>) return 5121;
  if constexpr (std::is_same_v<T, std::int16_t>) return 5122;
  if constexpr (std::is_same_v<T, std::uint16_t>) return 5123;
  if constexpr (std::is_same_v<T, std::uint32_t>) return 5125;
  if constexpr (std::is_same_v<T, float>) return 5126;
  return 0;
}

/// Builds small glTF documents. `json` is open: tests break it as they please before writing.
class GltfBuilder {
 public:
  nlohmann::json json = {{"asset", {{"version", "2.0"}}}};
  std::string binary;

  /// Appends bytes to the buffer, aligned to four; index of the new buffer view.
  int view(const void* data, std::size_t size, int stride = 0) {
    binary.resize((binary.size() + 3) / 4 * 4);
    nlohmann::json v = {{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", size}};
    if (stride > 0) v["byteStride"] = stride;
    binary.append(static_cast<const char*>(data), size);
    return add("bufferViews", std::move(v));
  }

  /// An accessor over `values`, `per_element` of them to an element; index of the new accessor.
  template <class T>
  int accessor(const std::vector<T>& values, int per_element, bool normalized = false) {
    static constexpr const char* kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    // Vertex attributes start at multiples of four bytes, so short elements are padded.
    const std::size_t packed = sizeof(T) * static_cast<std::size_t>(per_element);
    const std::size_t stride = per_element == 1 ? packed : (packed + 3) / 4 * 4;
    const std::size_t count = values.size() / static_cast<std::size_t>(per_element);
    std::string bytes(count * stride, '\0');
    for (std::size_t i = 0; i < count; ++i) {
      std::memcpy(&bytes[i * stride], &values[i * static_cast<std::size_t>(per_element)], packed);
    }
    const int v = view(bytes.data(), bytes.size(), stride == packed ? 0 : static_cast<int>(stride));
    nlohmann::json a = {{"bufferView", v},
                        {"componentType", component_type<T>()},
                        {"count", count},
                        {"type", kTypes[per_element]}};
    if (normalized) a["normalized"] = true;
    return add("accessors", std::move(a));
  }

  int mesh(nlohmann::json primitive) {
    return add("meshes", {{"primitives", nlohmann::json::array({std::move(primitive)})}});
  }
  /// Adds a node; index of the new node. The scene lists every node that no other has as a child.
  int node(nlohmann::json node) { return add("nodes", std::move(node)); }
  int material(nlohmann::json material) { return add("materials", std::move(material)); }
  /// An image in the buffer.
  int image(const std::string& bytes, const char* mime_type) {
    const int v = view(bytes.data(), bytes.size());
    return add("images", {{"bufferView", v}, {"mimeType", mime_type}});
  }
  int add(const char* collection, nlohmann::json element) {
    json[collection].push_back(std::move(element));
    return static_cast<int>(json[collection].size()) - 1;
  }

  /// The document with `scene`, `scenes` and `buffers` filled in where they are missing.
  nlohmann::json document(bool with_data_uri) const {
    nlohmann::json out = json;
    if (!out.contains("scenes")) out["scenes"] = {{{"nodes", roots()}}};
    if (!out.contains("scene") && !out["scenes"].empty()) out["scene"] = 0;
    if (!out.contains("buffers") && !binary.empty()) {
      nlohmann::json buffer = {{"byteLength", binary.size()}};
      if (with_data_uri) buffer["uri"] = "data:application/octet-stream;base64," + base64(binary);
      out["buffers"].push_back(std::move(buffer));
    }
    return out;
  }

  std::string gltf() const { return document(true).dump(); }

  std::string glb() const { return glb(document(false).dump(), binary); }

  static std::string glb(std::string text, std::string bin) {
    text.resize((text.size() + 3) / 4 * 4, ' ');
    bin.resize((bin.size() + 3) / 4 * 4, '\0');
    const std::size_t size = 12 + 8 + text.size() + (bin.empty() ? 0 : 8 + bin.size());
    std::string out = "glTF" + u32(2) + u32(size) + u32(text.size()) + "JSON" + text;
    if (!bin.empty()) out += u32(bin.size()) + std::string("BIN\0", 4) + bin;
    return out;
  }

  static std::string u32(std::size_t v) {
    std::string out(4, '\0');
    for (std::size_t i = 0; i < 4; ++i) out[i] = static_cast<char>(v >> (8 * i) & 0xff);
    return out;
  }

  static std::string base64(const std::string& bytes) {
    static constexpr char kLetters[] =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
      std::uint32_t bits = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        bits = bits << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
      }
      for (std::size_t k = 0; k < 4; ++k) {
        out += i + k > bytes.size() ? '=' : kLetters[bits >> (18 - 6 * k) & 63];
      }
    }
    return out;
  }

 private:
  nlohmann::json roots() const {
    std::vector<bool> is_child(json.contains("nodes") ? json["nodes"].size() : 0, false);
    nlohmann::json out = nlohmann::json::array();
    for (std::size_t n = 0; n < is_child.size(); ++n) {
      if (!json["nodes"][n].contains("children")) continue;
      for (const auto& child : json["nodes"][n]["children"]) {
        if (child.get<std::size_t>() < is_child.size()) is_child[child.get<std::size_t>()] = true;
      }
    }
    for (std::size_t n = 0; n < is_child.size(); ++n) {
      if (!is_child[n]) out.push_back(n);
    }
    return out;
  }
};

/// One triangle in the plane z = 0, counter-clockwise seen from +Z: (0,0,0), (1,0,0), (0,1,0).
inline std::vector<float> triangle_positions() {
  return {0, 0, 0, 1, 0, 0, 0, 1, 0};
}

/// A builder with that triangle under one node.
inline GltfBuilder triangle_builder() {
  GltfBuilder b;
  const int positions = b.accessor(triangle_positions(), 3);
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", positions}}}})}});
  return b;
}

}  // namespace kiln::test
