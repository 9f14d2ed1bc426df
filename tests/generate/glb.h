#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string>
#include <string_view>
#include <vector>

#include "baker/generate/generate.h"
#include "baker/math/vec.h"

/// Takes generated files apart.
namespace kiln::generate {

using nlohmann::json;

/// A generated file taken apart: only what the checks below look at.
struct Glb {
  json document;
  std::string bin;

  template <class T>
  std::vector<T> read(std::size_t accessor) const {
    const json& a = document["accessors"].at(accessor);
    const json& view = document["bufferViews"].at(a["bufferView"].get<std::size_t>());
    const std::size_t scalars = a["type"] == "SCALAR" ? 1 : a["type"] == "VEC2" ? 2 : 3;
    const std::size_t bytes =
        a["count"].get<std::size_t>() * scalars * (a["componentType"] == 5123 ? 2 : 4);
    EXPECT_EQ(bytes, view["byteLength"].get<std::size_t>());
    std::vector<T> values(bytes / sizeof(T));
    std::memcpy(values.data(), bin.data() + view["byteOffset"].get<std::size_t>(), bytes);
    return values;
  }

  std::vector<std::uint32_t> indices(std::size_t accessor) const {
    if (document["accessors"].at(accessor)["componentType"] == 5125)
      return read<std::uint32_t>(accessor);
    const auto small = read<std::uint16_t>(accessor);
    return {small.begin(), small.end()};
  }
};

inline Glb parse(const std::string& bytes) {
  std::uint32_t header[5];
  std::memcpy(header, bytes.data(), sizeof header);
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(header[2], bytes.size());
  const std::size_t json_bytes = header[3];
  return {json::parse(bytes.substr(20, json_bytes)), bytes.substr(28 + json_bytes)};
}

inline Glb generate(std::string_view name, std::uint32_t detail = 0) {
  const auto bytes = generate_glb(name, detail);
  EXPECT_TRUE(bytes.has_value());
  return parse(*bytes);
}

struct Triangle {
  std::array<math::Vec3, 3> position, normal;
  std::array<math::Vec2, 3> uv;
  std::string node;
  std::size_t chart = 0;  ///< connected by shared vertices
};

inline std::size_t root_of(std::vector<std::size_t>& parent, std::size_t i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

inline std::vector<Triangle> triangles_of(const Glb& glb) {
  std::vector<Triangle> all;
  std::size_t first_chart = 0;
  for (const json& node : glb.document["nodes"]) {
    if (!node.contains("mesh")) continue;
    for (const json& prim : glb.document["meshes"][node["mesh"].get<std::size_t>()]["primitives"]) {
      const json& a = prim["attributes"];
      const auto position = glb.read<math::Vec3>(a["POSITION"]),
                 normal = glb.read<math::Vec3>(a["NORMAL"]);
      const auto uv = glb.read<math::Vec2>(a["TEXCOORD_1"]);
      const auto index = glb.indices(prim["indices"]);
      std::vector<std::size_t> parent(position.size());
      std::iota(parent.begin(), parent.end(), std::size_t(0));
      for (std::size_t i = 0; i < index.size(); i += 3)
        for (std::size_t k = 1; k < 3; ++k)
          parent[root_of(parent, index.at(i + k))] = root_of(parent, index.at(i));
      for (std::size_t i = 0; i < index.size(); i += 3) {
        Triangle t;
        t.node = node["name"];
        t.chart = first_chart + root_of(parent, index[i]);
        for (std::size_t k = 0; k < 3; ++k) {
          t.position[k] = position.at(index[i + k]);
          t.normal[k] = normal.at(index[i + k]);
          t.uv[k] = uv.at(index[i + k]);
        }
        all.push_back(t);
      }
      first_chart += position.size();
    }
  }
  return all;
}

}  // namespace kiln::generate
