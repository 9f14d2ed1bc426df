#include "baker/generate/generate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "baker/atlas/atlas.h"
#include "baker/import/import.h"
#include "tests/generate/glb.h"
#include "tests/support/temp_files.h"

namespace kiln::generate {
namespace {

using nlohmann::json;

struct ChartBox {
  math::Vec2 min{2, 2}, max{-2, -2};
  double area = 0;  ///< of the triangles, signed, of [0,1]^2
  std::size_t triangles = 0;
};

std::map<std::size_t, ChartBox> charts_of(const std::vector<Triangle>& triangles) {
  std::map<std::size_t, ChartBox> charts;
  for (const Triangle& t : triangles) {
    ChartBox& box = charts[t.chart];
    for (const math::Vec2 uv : t.uv) {
      box.min = {std::min(box.min.x, uv.x), std::min(box.min.y, uv.y)};
      box.max = {std::max(box.max.x, uv.x), std::max(box.max.y, uv.y)};
    }
    box.area += 0.5 * double(cross(t.uv[1] - t.uv[0], t.uv[2] - t.uv[0]));
    ++box.triangles;
  }
  return charts;
}

class EveryGenerator : public testing::TestWithParam<std::string> {};

TEST_P(EveryGenerator, LiesOnOnePageWithoutOverlap) {
  const auto triangles = triangles_of(generate(GetParam()));
  ASSERT_FALSE(triangles.empty());
  for (const Triangle& t : triangles)
    ASSERT_LT(cross(t.uv[1] - t.uv[0], t.uv[2] - t.uv[0]), 0) << "mirrored or empty";
  const auto charts = charts_of(triangles);
  for (auto a = charts.begin(); a != charts.end(); ++a) {
    const ChartBox& box = a->second;
    for (const float edge : {box.min.x, box.min.y, box.max.x, box.max.y}) {
      EXPECT_EQ(edge * 128, std::round(edge * 128)) << "not on a whole texel";
      EXPECT_GE(edge, 1 / 128.f);
      EXPECT_LE(edge, 127 / 128.f);
    }
    // All of one orientation and as large as their box together: they can't overlap in it.
    const double whole = double(box.max.x - box.min.x) * double(box.max.y - box.min.y);
    EXPECT_NEAR(-box.area, box.triangles == 1 ? whole / 2 : whole, 1e-6);
    for (auto b = std::next(a); b != charts.end(); ++b) {
      const ChartBox& other = b->second;
      const float apart = std::max({box.min.x - other.max.x, other.min.x - box.max.x,
                                    box.min.y - other.max.y, other.min.y - box.max.y});
      EXPECT_GE(apart * 256, 4) << "gutter";
    }
  }
}

TEST_P(EveryGenerator, NormalsAreUnitAndLookWhereTheWindingSays) {
  for (const Triangle& t : triangles_of(generate(GetParam()))) {
    const math::Vec3 wound = cross(t.position[1] - t.position[0], t.position[2] - t.position[0]);
    ASSERT_GT(length(wound), 0) << t.node;
    for (const math::Vec3 n : t.normal) {
      ASSERT_NEAR(length(n), 1, 1e-5) << t.node;
      ASSERT_GT(dot(n, normalize(wound)), 0.3f) << t.node;
    }
  }
}

TEST_P(EveryGenerator, GivesTheSameBytesAgain) {
  EXPECT_EQ(*generate_glb(GetParam()), *generate_glb(GetParam()));
}

TEST_P(EveryGenerator, NamesEverythingAndListsItsExtensions) {
  const json document = generate(GetParam()).document;
  std::set<std::string> names, used, listed;
  for (const json& node : document["nodes"]) EXPECT_TRUE(names.insert(node["name"]).second);
  for (const json& material : document["materials"]) {
    EXPECT_TRUE(material.contains("name"));
    if (material.contains("extensions"))
      for (const auto& [key, value] : material["extensions"].items()) used.insert(key);
  }
  if (document.contains("extensions"))
    for (const auto& [key, value] : document["extensions"].items()) used.insert(key);
  if (document.contains("extensionsUsed"))
    for (const json& name : document["extensionsUsed"]) listed.insert(name);
  EXPECT_EQ(used, listed);
}

TEST_P(EveryGenerator, IsImportedAndItsLayoutUsedAsItIs) {
  const test::TempFolder folder;
  const auto file = folder.write("scene.glb", *generate_glb(GetParam()));
  proto::BakeSettings settings;
  settings.allow_dark = true;
  settings.atlas.page_size = 256;
  const auto scene = import::import_scene({file, {}}, settings);
  ASSERT_TRUE(scene.has_value()) << scene.error().message;
  EXPECT_TRUE(scene->warnings.empty());
  EXPECT_EQ(scene->triangles.size(), triangles_of(generate(GetParam())).size());
  const auto atlas = atlas::build_atlas(*scene, settings.atlas);
  ASSERT_TRUE(atlas.has_value()) << atlas.error().message;
  EXPECT_EQ(atlas->page_count, 1u);
  for (const atlas::InstancePlacement& placement : atlas->placements) {
    EXPECT_TRUE(placement.uses_source_uv) << placement.reason;
    EXPECT_EQ(placement.scale, (math::Vec2{1, 1}));
    EXPECT_EQ(placement.offset, (math::Vec2{0, 0}));
  }
}

std::vector<std::string> generator_names() {
  std::vector<std::string> names;
  for (const GeneratorInfo& info : generators()) names.emplace_back(info.name);
  return names;
}

INSTANTIATE_TEST_SUITE_P(Generate, EveryGenerator, testing::ValuesIn(generator_names()),
                         [](const auto& tested) { return tested.param; });

double area_of(const std::vector<Triangle>& triangles, const std::string& node) {
  double area = 0;
  for (const Triangle& t : triangles)
    if (node.empty() || t.node == node)
      area +=
          0.5 * double(length(cross(t.position[1] - t.position[0], t.position[2] - t.position[0])));
  return area;
}

TEST(Generate, SurfacesHaveTheirRealSizes) {
  EXPECT_NEAR(area_of(triangles_of(generate("cornell")), "lamp"), 1.3 * 1.05, 1e-6);
  EXPECT_NEAR(area_of(triangles_of(generate("furnace")), ""), 2 * (4 * 2 + 4 * 3 + 2 * 3), 1e-4);
  EXPECT_NEAR(area_of(triangles_of(generate("plates")), "receiver"), 1, 1e-6);
  // The polyhedron of detail n falls short of 4 pi by O(1/n^2).
  EXPECT_NEAR(area_of(triangles_of(generate("sphere_on_plane", 64)), "ball"), 4 * M_PI, 0.01);
}

TEST(Generate, TheFurnaceIsClosedAndFacesInwards) {
  for (const Triangle& t : triangles_of(generate("furnace_90")))
    EXPECT_GT(dot(t.normal[0], math::Vec3{0, 1, 0} - t.position[0]), 0);
}

/// Every edge of a closed surface has exactly two triangles, even across charts.
TEST(Generate, BallsAreWatertight) {
  using Point = std::array<float, 3>;
  std::map<std::pair<Point, Point>, int> edges;
  for (const Triangle& t : triangles_of(generate("bumpy_ball", 13))) {
    if (t.node != "statue") continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const math::Vec3 a = t.position[k], b = t.position[(k + 1) % 3];
      const Point p{a.x, a.y, a.z}, q{b.x, b.y, b.z};
      edges[std::minmax(p, q)] += p < q ? 1 : -1;
    }
  }
  EXPECT_EQ(edges.size(), 12u * 13 * 13 * 3 / 2);
  for (const auto& [edge, balance] : edges) EXPECT_EQ(balance, 0);
}

TEST(Generate, DetailSetsTheNumberOfTriangles) {
  const auto count = [](std::uint32_t detail) {
    const auto all = triangles_of(generate("bumpy_ball", detail));
    return std::count_if(all.begin(), all.end(),
                         [](const Triangle& t) { return t.node == "statue"; });
  };
  EXPECT_EQ(count(2), 12 * 2 * 2);
  EXPECT_EQ(count(0), 99372);
}

TEST(Generate, EmissionAboveOneGoesToTheStrength) {
  const auto cornell = generate("cornell");
  for (const json& m : cornell.document["materials"]) {
    if (m["name"] != "lamp") continue;
    EXPECT_EQ(m["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"], 17);
    EXPECT_EQ(m["emissiveFactor"][0], 1);
    EXPECT_NEAR(m["emissiveFactor"][1].get<double>() * 17, 12, 1e-5);
    EXPECT_NEAR(m["emissiveFactor"][2].get<double>() * 17, 4, 1e-5);
  }
}

TEST(Generate, LightsPointWhereTheyShould) {
  const json nodes = generate("plane_sun").document["nodes"];
  const auto sun = std::find_if(nodes.begin(), nodes.end(),
                                [](const json& node) { return node["name"] == "sun"; });
  ASSERT_NE(sun, nodes.end());
  const json& q = sun->at("rotation");
  const math::Vec3 axis{q[0], q[1], q[2]};
  const float w = q[3];
  const math::Vec3 v{0, 0, -1};
  const math::Vec3 turned = v + cross(axis, cross(axis, v) + v * w) * 2;  // v rotated by q
  EXPECT_NEAR(turned.x, 0.6, 1e-6);
  EXPECT_NEAR(turned.y, -0.8, 1e-6);
  EXPECT_NEAR(turned.z, 0, 1e-6);
}

TEST(Generate, UnknownNameListsTheKnownOnes) {
  const auto result = generate_glb("cornel");
  ASSERT_FALSE(result.has_value());
  EXPECT_EQ(result.error().code, "unknown_generator");
  EXPECT_NE(result.error().message.find("bumpy_ball"), std::string::npos);
}

TEST(Generate, TooMuchDetailIsRefused) {
  EXPECT_EQ(generate_glb("cornell_lucy", 33).error().code, "invalid_detail");
  EXPECT_EQ(generate_glb("cornell", kMaxDetail + 1).error().code, "invalid_detail");
}

}  // namespace
}  // namespace kiln::generate
