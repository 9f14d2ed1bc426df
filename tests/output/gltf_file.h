#pragma once

#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/temp_files.h"

namespace kiln::output {

using Json = nlohmann::ordered_json;

/// A glTF under construction: JSON to edit freely, and one buffer.
struct GltfFile {
  Json json = Json::parse(R"({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}],
      "nodes": [], "meshes": [], "accessors": [], "bufferViews": []})");
  std::string bin;

  template <class T>
  int view(const std::vector<T>& values) {
    bin.resize((bin.size() + 3) / 4 * 4);
    json["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", values.size() * sizeof(T)}});
    bin.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    return int(json["bufferViews"].size()) - 1;
  }
  int add(const char* collection, Json item) {
    json[collection].push_back(std::move(item));
    return int(json[collection].size()) - 1;
  }
  template <class T>
  int accessor(const std::vector<T>& values, int component_type, const char* type, int components) {
    return add("accessors", {{"bufferView", view(values)},
                             {"componentType", component_type},
                             {"count", values.size() / std::size_t(components)},
                             {"type", type}});
  }
  int floats(const std::vector<float>& values, const char* type, int components) {
    return accessor(values, 5126, type, components);
  }
  int positions(const std::vector<float>& values) {
    const int a = floats(values, "VEC3", 3);
    Json min = Json::array(), max = Json::array();
    for (int c = 0; c < 3; ++c) {
      float low = values[std::size_t(c)], high = low;
      for (std::size_t i = std::size_t(c); i < values.size(); i += 3) {
        low = std::min(low, values[i]);
        high = std::max(high, values[i]);
      }
      min.push_back(low);
      max.push_back(high);
    }
    json["accessors"][a]["min"] = min;
    json["accessors"][a]["max"] = max;
    return a;
  }
  int mesh(Json primitive) {
    return add("meshes", {{"primitives", Json::array({std::move(primitive)})}});
  }
  int node(Json node) {
    const int n = add("nodes", std::move(node));
    json["scenes"][0]["nodes"].push_back(n);
    return n;
  }

  std::string glb() const {
    Json whole = json;
    std::string padded = bin;
    padded.resize((padded.size() + 3) / 4 * 4);
    whole["buffers"] = Json::array({{{"byteLength", padded.size()}}});
    std::string text = whole.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const auto u32 = [](std::size_t v) {
      const auto n = std::uint32_t(v);
      return std::string(reinterpret_cast<const char*>(&n), 4);
    };
    return "glTF" + u32(2) + u32(28 + text.size() + padded.size()) + u32(text.size()) + "JSON" +
           text + u32(padded.size()) + std::string("BIN\0", 4) + padded;
  }
};

/// A .glb taken apart.
struct GlbReader {
  Json json;
  std::string bin;

  explicit GlbReader(const std::filesystem::path& path) {
    const std::string bytes = test::read_bytes(path);
    const auto u32 = [&](std::size_t at) {
      std::uint32_t n = 0;
      std::memcpy(&n, bytes.data() + at, 4);
      return n;
    };
    if (bytes.size() < 28 || bytes.substr(0, 4) != "glTF" || u32(8) != bytes.size())
      throw std::runtime_error("not a whole .glb");
    json = Json::parse(bytes.substr(20, u32(12)));
    bin = bytes.substr(28 + u32(12));
    if (bin.size() != json["buffers"][0]["byteLength"])
      throw std::runtime_error("the BIN chunk is not buffer 0");
  }
  std::string view(int index) const {
    const Json& v = json["bufferViews"][index];
    return bin.substr(v.value("byteOffset", 0u), v["byteLength"]);
  }
  /// Values of an accessor without sparse parts.
  template <class T>
  std::vector<T> values(int index, int components) const {
    const Json& a = json["accessors"][index];
    const std::string bytes = view(a["bufferView"]).substr(a.value("byteOffset", 0u));
    const std::size_t element = sizeof(T) * std::size_t(components);
    const std::size_t stride =
        json["bufferViews"][int(a["bufferView"])].value("byteStride", element);
    std::vector<T> out(a["count"].get<std::size_t>() * std::size_t(components));
    for (std::size_t i = 0; i < a["count"]; ++i)
      std::memcpy(out.data() + i * std::size_t(components), bytes.data() + i * stride, element);
    return out;
  }
};

}  // namespace kiln::output
