#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/atlas/clip.h"

namespace kiln::atlas {

inline std::vector<std::int64_t> empty_page(const Atlas& atlas) {
  return std::vector<std::int64_t>(std::size_t(atlas.page_size) * atlas.page_size, -1);
}

/// Paints each page with chart numbers, by exact clipping. Fails where two charts share a texel or
/// where the faces of one cover a texel by more than 1 + `slack`: coordinates are floats, an edge
/// may be off by 1e-4 texel.
inline std::vector<std::vector<std::int64_t>> paint_charts(const Atlas& atlas,
                                                           double slack = 1e-3) {
  std::vector<std::vector<std::int64_t>> pages(atlas.page_count, empty_page(atlas));
  std::vector<std::vector<double>> cover(
      atlas.page_count, std::vector<double>(std::size_t(atlas.page_size) * atlas.page_size, 0));
  std::uint64_t shared = 0, twice = 0;
  for (std::uint32_t t = 0; t < atlas.triangles.size(); ++t) {
    const std::uint32_t page = atlas.page_of(t);
    const std::int64_t chart = atlas.triangle_chart[t];
    const int size = int(atlas.page_size);
    for_texels(UvTriangle(atlas, t).polygon(), 0, size, size, [&](int x, int y, double area) {
      const auto at = std::size_t(y) * atlas.page_size + std::size_t(x);
      auto& owner = pages[page][at];
      shared += owner >= 0 && owner != chart;
      owner = chart;
      cover[page][at] += area;
    });
  }
  for (const auto& page : cover) {
    for (const double c : page) twice += c > 1 + slack;
  }
  EXPECT_EQ(shared, 0u) << "texels of two charts";
  EXPECT_EQ(twice, 0u) << "texels that are covered twice";
  return pages;
}

/// Every texel within `gutter` (in both axes) of a chart is empty or the chart's own, and lies on
/// the page.
inline void expect_gutter(const Atlas& atlas, int gutter, double slack = 1e-3) {
  const int size = int(atlas.page_size);
  std::uint64_t near = 0, beyond = 0;
  for (const auto& page : paint_charts(atlas, slack)) {
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        const std::int64_t chart = page[std::size_t(y * size + x)];
        if (chart < 0) continue;
        beyond += x < gutter || y < gutter || x + gutter >= size || y + gutter >= size;
        for (int dy = -gutter; dy <= gutter; ++dy) {
          for (int dx = -gutter; dx <= gutter; ++dx) {
            if (x + dx < 0 || y + dy < 0 || x + dx >= size || y + dy >= size) continue;
            const std::int64_t other = page[std::size_t((y + dy) * size + x + dx)];
            near += other >= 0 && other != chart;
          }
        }
      }
    }
  }
  EXPECT_EQ(near, 0u) << "texels too near to another chart";
  EXPECT_EQ(beyond, 0u) << "texels too near to the page's edge";
}

/// The arrays fit each other, whatever the scene.
inline void expect_consistent(const scene::Scene& scene, const Atlas& atlas) {
  ASSERT_EQ(atlas.triangles.size(), scene.triangles.size());
  ASSERT_EQ(atlas.triangle_chart.size(), scene.triangles.size());
  ASSERT_EQ(atlas.placements.size(), scene.instances.size());
  ASSERT_EQ(atlas.part_first_vertex.size(), scene.parts.size() + 1);
  ASSERT_EQ(atlas.part_first_vertex.back(), atlas.vertices.size());
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const std::uint32_t part = scene.triangle_part[t];
    const auto& chart = atlas.charts.at(atlas.triangle_chart[t]);
    ASSERT_EQ(chart.instance, scene.parts[part].instance);
    ASSERT_EQ(chart.page, atlas.placements[chart.instance].page);
    ASSERT_LT(chart.page, atlas.page_count);
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t v = atlas.triangles[t][k];
      ASSERT_GE(v, atlas.part_first_vertex[part]);
      ASSERT_LT(v, atlas.part_first_vertex[part + 1]);
      ASSERT_EQ(atlas.vertices[v].scene_vertex, scene.triangles[t][k]);
      const math::Vec2 uv = atlas.vertices[v].uv;
      ASSERT_TRUE(uv.x >= chart.min.x && uv.y >= chart.min.y);
      ASSERT_TRUE(uv.x <= chart.max.x && uv.y <= chart.max.y);
      ASSERT_TRUE(uv.x >= 0 && uv.y >= 0);
      ASSERT_TRUE(uv.x <= float(atlas.page_size) && uv.y <= float(atlas.page_size));
    }
  }
}

}  // namespace kiln::atlas
