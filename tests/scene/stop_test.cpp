// A stop request is seen within a second, wherever the import is.
#include <gtest/gtest.h>

#include <cmath>

#include "scene/import_helpers.h"
#include "support/sanitizer.h"
#include "support/stop_timing.h"

namespace kiln::baker {
namespace {

constexpr std::uint32_t kCells = test::kSlowdown > 1 ? 300 : 1000;  // two triangles each

/// Hills of kCells x kCells cells.
struct Hills {
  std::vector<float> positions, normals, uvs;
  std::vector<std::uint32_t> indices;

  Hills() {
    const std::uint32_t row = kCells + 1;
    for (std::uint32_t z = 0; z < row; ++z) {
      for (std::uint32_t x = 0; x < row; ++x) {
        const float u = float(x) / float(kCells), v = float(z) / float(kCells);
        const float height = 2 * std::sin(9 * u) * std::cos(7 * v);
        positions.insert(positions.end(), {20 * u, height, 20 * v});
        normals.insert(normals.end(), {0, 1, 0});
        uvs.insert(uvs.end(), {u, v});
      }
    }
    for (std::uint32_t z = 0; z < kCells; ++z) {
      for (std::uint32_t x = 0; x < kCells; ++x) {
        const std::uint32_t a = z * row + x, b = a + 1, c = a + row;
        indices.insert(indices.end(), {a, c, b, b, c, c + 1});
      }
    }
  }
};

enum class Shading { kSmooth, kFlat };

std::string hills(Shading shading) {
  const Hills h;
  GltfBuilder b;
  nlohmann::json attributes = {{"POSITION", b.accessor(h.positions, 3)}};
  if (shading == Shading::kSmooth) {
    attributes["NORMAL"] = b.accessor(h.normals, 3);
    attributes["TEXCOORD_0"] = attributes["TEXCOORD_1"] = b.accessor(h.uvs, 2);
  }
  const int indices = b.accessor(h.indices, 1);
  b.node({{"mesh", b.mesh({{"attributes", attributes}, {"indices", indices}})}});
  return b.glb();
}

/// A document of about 20 MB, all JSON.
std::string many_nodes() {
  GltfBuilder b = triangle_builder();
  for (int i = 1; i < 250'000 / test::kSlowdown; ++i)
    b.node({{"mesh", 0}, {"translation", {0.125 * i, 0.5, 1}}, {"rotation", {0, 0, 0, 1}}});
  return b.gltf();
}

void expect_quick_stops_of_import(const std::string& bytes) {
  const Upload upload(bytes);
  test::expect_quick_stops(
      [&](std::stop_token stop) { return import_scene(upload.files, dark(), {}, stop); });
  test::expect_quick_stops(
      [&](std::stop_token stop) { return check_scene(upload.files, dark(), {}, stop); });
}

TEST(Stop, TwoMillionTrianglesWithNormals) {
  expect_quick_stops_of_import(hills(Shading::kSmooth));
}

TEST(Stop, TwoMillionTrianglesWithoutNormals) {
  expect_quick_stops_of_import(hills(Shading::kFlat));
}

TEST(Stop, ALargeDocument) {
  expect_quick_stops_of_import(many_nodes());
}

}  // namespace
}  // namespace kiln::baker
