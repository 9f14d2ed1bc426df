#include "tests/bake/guarded_scenes.h"

#include <array>
#include <cmath>
#include <stdexcept>

#include "baker/generate/generate.h"
#include "tests/support/packed_gltf.h"
#include "tests/support/sky_files.h"

namespace kiln::test {
namespace {

using math::Rgb;

/// Draws a sky with a gradient and a small sun, pixel by pixel and without libm.
SkyPicture sky(std::uint32_t rows, math::Rgb sun) {
  std::uint32_t pixel = 0;
  return {rows, [&](math::Vec3) -> math::Rgb {
            const std::uint32_t x = pixel % (2 * rows), y = pixel++ / (2 * rows);
            if (x / 2 == rows / 4 && y == rows / 8) return sun;
            const float height = 1 - float(y) / float(rows), side = float(x) / float(2 * rows);
            return {0.2f + 0.5f * height * side, 0.3f + 0.4f * height, 0.25f + 0.75f * height};
          }};
}

/// The six faces of a cube of side 2 around the origin, flat, each with a place of its own in
/// TEXCOORD_1.
struct CubeFaces {
  std::vector<float> positions;
  std::vector<std::uint16_t> uv, indices;

  CubeFaces() {
    for (std::uint16_t face = 0; face < 6; ++face) {
      const std::size_t axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
      const float side = face % 2 == 0 ? 1.f : -1.f;
      for (const auto& [a, b] :
           std::array<std::array<float, 2>, 4>{{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}}) {
        std::array<float, 3> p{};
        p[axis] = side, p[u] = a * side, p[v] = b;
        positions.insert(positions.end(), p.begin(), p.end());
        const float x = (float(face % 3) + 0.5f + 0.4f * a) / 3;
        const float y = (float(face / 3) + 0.5f + 0.4f * b) / 2;
        for (const float place : {x, y}) uv.push_back(std::uint16_t(place * 65535));
      }
      for (const int corner : {0, 1, 2, 0, 2, 3})
        indices.push_back(std::uint16_t(4 * face + corner));
    }
  }
};

/// Builds cubes that share meshes on a slab and under a lamp. One is mirrored, some are seen from
/// both sides. The file is compressed by meshopt.
std::string instances() {
  const CubeFaces cube;
  GltfBuilder b;
  const int p = b.accessor(cube.positions, 3), uv = b.accessor(cube.uv, 2, true),
            i = b.accessor(cube.indices, 1);
  const auto mesh = [&](nlohmann::json material) {
    return b.mesh({{"attributes", {{"POSITION", p}, {"TEXCOORD_1", uv}}},
                   {"indices", i},
                   {"material", b.material(std::move(material))}});
  };
  const int clay = mesh(
      {{"pbrMetallicRoughness", {{"baseColorFactor", {0.8, 0.5, 0.3, 1}}}}, {"doubleSided", true}});
  const int stone = mesh({{"pbrMetallicRoughness", {{"baseColorFactor", {0.5, 0.6, 0.7, 1}}}}});
  const int lamp =
      mesh({{"emissiveFactor", {1, 0.9, 0.6}},
            {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 300}}}}}});
  b.node({{"mesh", stone}, {"translation", {0, -1, 0}}, {"scale", {5, 0.5, 5}}});
  b.node({{"mesh", stone}, {"translation", {0, 2, -5}}, {"scale", {5, 4, 0.2}}});
  b.node({{"mesh", clay}, {"translation", {-2, 0.5, 0}}});
  b.node({{"mesh", clay}, {"translation", {2, 0.4, 1}}, {"rotation", {0, 0.6, 0, 0.8}}});
  b.node({{"mesh", clay}, {"translation", {0, 0.2, 2.5}}, {"scale", {-0.8, 0.7, 0.7}}});
  b.node({{"mesh", lamp}, {"translation", {0.5, 4, -1}}, {"scale", {0.6, 0.05, 0.4}}});
  GltfBuilder packed = packed_by_meshopt(
      std::move(b),
      {{"ATTRIBUTES", "NONE", 12}, {"ATTRIBUTES", "NONE", 4}, {"TRIANGLES", "NONE", 2}});
  packed.json["extensionsUsed"].push_back("KHR_materials_emissive_strength");
  return packed.glb();
}

/// Builds a dish with smooth normals and without lightmap UVs. The file is compressed by Draco.
std::string dish() {
  constexpr std::uint32_t kCells = 12;
  std::vector<float> positions, normals;
  std::vector<std::uint32_t> indices;
  for (std::uint32_t y = 0; y <= kCells; ++y)
    for (std::uint32_t x = 0; x <= kCells; ++x) {
      const float u = 2 * float(x) / kCells - 1, v = 2 * float(y) / kCells - 1;
      positions.insert(positions.end(), {u, 0.8f * (u * u + v * v), -v});
      const float length = std::sqrt(1 + 2.56f * (u * u + v * v));
      normals.insert(normals.end(), {-1.6f * u / length, 1 / length, 1.6f * v / length});
      if (x == kCells || y == kCells) continue;
      const std::uint32_t a = y * (kCells + 1) + x, c = a + kCells + 2;
      indices.insert(indices.end(), {a, a + 1, c, a, c, c - 1});
    }
  return packed_by_draco(positions, normals, indices, /*edgebreaker=*/true).glb();
}

constexpr const char* kFourLights = R"({"lights": [
  {"type": "directional", "intensity": 30, "direction": [0.3, -1, 0.2], "color": [1, 0.9, 0.8]},
  {"type": "point", "intensity": 20, "position": [-1, 0.6, 1], "range": 4},
  {"type": "spot", "intensity": 50, "position": [1, 1.5, 1], "direction": [-0.4, -1, 0],
   "inner_cone_angle": 0.2, "outer_cone_angle": 0.6},
  {"type": "rect", "intensity": 15, "position": [0, 2, -1], "direction": [0, -1, 0.3],
   "width": 0.5, "height": 0.8}]})";

std::function<std::string()> generator(const char* name, std::uint32_t detail = 0) {
  return [=] {
    const auto glb = generate::generate_glb(name, detail);
    if (!glb) throw std::runtime_error(glb.error().message);
    return *glb;
  };
}

}  // namespace

std::vector<GuardedScene> guarded_scenes() {
  return {
      {"cornell",
       generator("cornell"),
       "{}",
       R"({"atlas": {"texels_per_metre": 4.2}, "solver": {"ray_pattern": "tile"}})",
       {}},
      {"bumpy_ball",
       generator("bumpy_ball", 6),
       "{}",
       R"({"atlas": {"texels_per_metre": 4.2}, "solver": {"ray_pattern": "block"}})",
       {}},
      {"cornell_shelves",
       generator("cornell_shelves"),
       R"({"solver": {"hit_memory_mib": 1}})",
       R"({"atlas": {"texels_per_metre": 4}, "solver": {"ray_pattern": "strata"}})",
       {}},
      {"room_textured",
       generator("room_textured"),
       R"({"output": {"precision": "half"}})",
       R"({"atlas": {"texels_per_metre": 6}, "solver": {"ray_pattern": "incoherent"}})",
       {}},
      {"many_lights",
       generator("many_lights"),
       "{}",
       R"({"atlas": {"texels_per_metre": 3, "gutter": 1}})",
       {}},
      {"courtyard",
       generator("courtyard"),
       R"({"sky": {"map": "noon.hdr", "scale": 1500, "rotation": 30}})",
       R"({"atlas": {"texels_per_metre": 2.2}})",
       {{"noon.hdr", hdr_file(sky(32, {9000, 8000, 6000}))}}},
      {"sphere_on_plane",
       generator("sphere_on_plane", 8),
       R"({"sky": {"radiance": [800, 900, 1000]}})",
       R"({"atlas": {"texels_per_metre": 9}, "solver": {"without": ["low_discrepancy"]}})",
       {}},
      {"furnace_90",
       generator("furnace_90"),
       R"({"solver": {"tolerance": 0}})",
       R"({"atlas": {"texels_per_metre": 9},
           "solver": {"without": ["closed_form", "shadow_probes"]}})",
       {}},
      {"sealed",
       generator("sealed"),
       R"({"solver": {"samples": 64, "direct_samples": 64}})",
       R"({"atlas": {"texels_per_metre": 10}, "post": {"dilate": 0},
           "solver": {"without": ["light_importance"]}})",
       {}},
      {"four_lights",
       generator("rect_light"),
       kFourLights,
       R"({"atlas": {"texels_per_metre": 20}})",
       {}},
      {"instances",
       instances,
       R"({"sky": {"radiance": [1, 1.5, 2]}, "atlas": {"gutter": 1}})",
       R"({"atlas": {"texels_per_metre": 4.8, "unwrap": "existing"}})",
       {}},
      {"dish",
       dish,
       R"({"sky": {"map": "dusk.exr", "scale": 40}})",
       R"({"atlas": {"texels_per_metre": 24, "gutter": 2}})",
       {{"dusk.exr", exr_file(sky(16, {500, 200, 60}))}}},
  };
}

}  // namespace kiln::test
