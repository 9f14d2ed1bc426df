#pragma once

#include <gtest/gtest.h>

#include <bit>

#include "baker/atlas/atlas.h"
#include "baker/import/import.h"
#include "baker/output/lit/lit_glb.h"
#include "baker/output/output.h"
#include "tests/output/gltf_file.h"

namespace kiln::output {

inline constexpr std::uint32_t kPageSize = 64;

/// How the tests lay a scene out: what matters to lit.glb is only where each corner lies.
enum class Layout {
  kWhole,        ///< each source vertex has one place on the page
  kPerTriangle,  ///< every triangle is a chart: all shared vertices split
  kSource,       ///< TEXCOORD_1 as it is
};

/// `pages`: instance i lies on page i % pages.
inline atlas::Atlas lay_out(const scene::Scene& scene, Layout layout, std::uint32_t pages = 1) {
  atlas::Atlas atlas;
  atlas.page_size = kPageSize;
  atlas.page_count = pages;
  const bool split = layout == Layout::kPerTriangle;
  for (const scene::Part& part : scene.parts) {
    atlas.part_first_vertex.push_back(std::uint32_t(atlas.vertices.size()));
    const std::uint32_t base = atlas.part_first_vertex.back();
    for (std::uint32_t v = 0; !split && v < part.vertex_count; ++v) {
      const std::uint32_t s = part.first_vertex + v;
      const float place = float(scene.source_vertex[s]);
      const math::Vec2 uv = layout == Layout::kSource
                                ? scene.lightmap_uv[s] * float(kPageSize)
                                : math::Vec2{place + 0.25f, float(part.instance) + 0.5f};
      atlas.vertices.push_back({s, uv});
    }
    for (std::uint32_t t = part.first_triangle; t < part.first_triangle + part.triangle_count;
         ++t) {
      std::array<std::uint32_t, 3> corners = scene.triangles[t];
      for (std::uint32_t c = 0; c < 3; ++c) {
        if (!split) {
          corners[c] = base + corners[c] - part.first_vertex;
          continue;
        }
        atlas.vertices.push_back({corners[c], {float(t) + 0.25f * float(c), float(part.instance)}});
        corners[c] = std::uint32_t(atlas.vertices.size()) - 1;
      }
      atlas.triangles.push_back(corners);
      atlas.triangle_chart.push_back(part.instance);
    }
  }
  atlas.part_first_vertex.push_back(std::uint32_t(atlas.vertices.size()));
  for (std::uint32_t i = 0; i < scene.instances.size(); ++i) {
    atlas.charts.push_back({i, i % pages, {}, {}});
    atlas.placements.push_back({i % pages, layout == Layout::kSource, {1, 1}, {0, 0}, ""});
  }
  return atlas;
}

inline proto::BakeSettings dark() {
  proto::BakeSettings settings;
  settings.allow_dark = true;
  return settings;
}

/// 4 x 2 texels, so that pages are told apart by their scale.
inline LitPages lit_pages(std::uint32_t pages) {
  LitPages out;
  for (std::uint32_t p = 0; p < pages; ++p) {
    const std::vector<std::array<std::uint8_t, 3>> gray(8, {100, 100, 100});
    out.pages.push_back(
        {image::encode_png(gray, 4, 2).value(), 50.f * float(p + 1), "page.exr", 0.5f, 3, 2});
  }
  return out;
}

/// The scene of those files, laid out, lit by those pages and read back.
inline GlbReader light(const test::TempFolder& folder, const files::SceneFiles& files,
                       Layout layout, const LitPages& lit) {
  const auto scene = import::import_scene(files, dark());
  if (!scene) throw std::runtime_error("import: " + scene.error().message);
  const auto path = folder.path() / "lit.glb";
  const auto pages = std::uint32_t(lit.pages.size());
  const auto written = lit::write_lit_glb(path, files, *scene, lay_out(*scene, layout, pages), lit);
  if (!written) throw std::runtime_error("lit.glb: " + written.error().message);
  return GlbReader(path);
}

inline GlbReader light(const test::TempFolder& folder, const files::SceneFiles& files,
                       Layout layout, std::uint32_t pages = 1) {
  return light(folder, files, layout, lit_pages(pages));
}

inline files::SceneFiles save(const test::TempFolder& folder, const GltfFile& gltf) {
  std::ofstream(folder.path() / "scene.glb", std::ios::binary) << gltf.glb();
  return {folder.path() / "scene.glb", {}};
}

inline GlbReader light(const test::TempFolder& folder, const GltfFile& gltf, Layout layout,
                       std::uint32_t pages = 1) {
  return light(folder, save(folder, gltf), layout, pages);
}

/// Returns a triangle with normals, so that its vertices stay, and a material.
inline GltfFile triangle() {
  GltfFile g;
  const int position = g.positions({0, 0, 0, 1, 0, 0, 0, 1, 0});
  const int normal = g.floats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3", 3);
  const int uv = g.floats({0, 0, 1, 0, 0, 1}, "VEC2", 2);
  g.add("materials", {{"name", "paint"}});
  g.mesh({{"attributes", {{"POSITION", position}, {"NORMAL", normal}, {"TEXCOORD_0", uv}}},
          {"material", 0}});
  g.node({{"mesh", 0}, {"name", "leaf"}});
  return g;
}

}  // namespace kiln::output
