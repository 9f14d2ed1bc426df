#pragma once

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "baker/import/import.h"
#include "tests/support/gltf_builder.h"
#include "tests/support/temp_files.h"

namespace kiln::import {

using test::GltfBuilder;
using test::triangle_builder;
using test::triangle_positions;

inline proto::BakeSettings dark() {
  proto::BakeSettings settings;
  settings.allow_dark = true;
  return settings;
}

/// An upload on disk.
struct Upload {
  test::TempFolder folder;
  files::SceneFiles files;

  explicit Upload(const std::string& bytes, const std::map<std::string, std::string>& side = {}) {
    files.main = folder.write("scene", bytes);
    int n = 0;
    for (const auto& [name, content] : side) {
      files.side[name] = folder.write("side" + std::to_string(n++), content);
    }
  }
};

inline proto::Expected<scene::Scene> import_bytes(const std::string& bytes,
                                                  const proto::BakeSettings& settings = dark(),
                                                  const files::ImportLimits& limits = {}) {
  const Upload upload(bytes);
  return import_scene(upload.files, settings, limits);
}

/// The scene of a document that must import; an empty scene and a failure otherwise.
inline scene::Scene imported(const std::string& bytes,
                             const proto::BakeSettings& settings = dark()) {
  auto scene = import_bytes(bytes, settings);
  if (scene) return std::move(*scene);
  ADD_FAILURE() << scene.error().code << ": " << scene.error().message;
  return {};
}
inline scene::Scene imported(const GltfBuilder& b) {
  return imported(b.glb());
}

/// The corners of all triangles, in order.
inline std::vector<math::Vec3> corners(const scene::Scene& scene) {
  std::vector<math::Vec3> out;
  for (const auto& t : scene.triangles) {
    for (const auto v : t) out.push_back(scene.positions[v]);
  }
  return out;
}

inline std::vector<std::string> warning_codes(const scene::Scene& scene) {
  std::vector<std::string> out;
  for (const auto& w : scene.warnings) out.push_back(w.code);
  return out;
}

inline void expect_near(math::Vec3 a, math::Vec3 b, float tolerance = 0) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

}  // namespace kiln::import
