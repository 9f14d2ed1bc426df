// The scenes of the theses: their numbers of triangles, their sizes, and that their solids are
// closed.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "tests/generate/glb.h"

namespace kiln::generate {
namespace {

std::vector<Triangle> only(const std::vector<Triangle>& all, const std::string& node) {
  std::vector<Triangle> some;
  std::copy_if(all.begin(), all.end(), std::back_inserter(some),
               [&](const Triangle& t) { return t.node == node; });
  return some;
}

struct Bounds {
  math::Vec3 low{1e9f, 1e9f, 1e9f}, high{-1e9f, -1e9f, -1e9f};
};

Bounds bounds_of(const std::vector<Triangle>& triangles) {
  Bounds b;
  for (const Triangle& t : triangles)
    for (const math::Vec3 p : t.position) {
      b.low = {std::min(b.low.x, p.x), std::min(b.low.y, p.y), std::min(b.low.z, p.z)};
      b.high = {std::max(b.high.x, p.x), std::max(b.high.y, p.y), std::max(b.high.z, p.z)};
    }
  return b;
}

/// Returns six times the volume that a closed surface holds: positive where it faces outwards.
double six_volumes(const std::vector<Triangle>& triangles) {
  double sum = 0;
  for (const Triangle& t : triangles)
    sum += dot(math::to_double(t.position[0]),
               cross(math::to_double(t.position[1]), math::to_double(t.position[2])));
  return sum;
}

struct Counted {
  const char* scene;
  std::size_t least, most;
};

void PrintTo(const Counted& c, std::ostream* out) {
  *out << c.scene;
}

class TriangleCounts : public testing::TestWithParam<Counted> {};

TEST_P(TriangleCounts, AreThoseOfTheTheses) {
  const Counted& c = GetParam();
  const std::size_t count = triangles_of(generate(c.scene)).size();
  EXPECT_GE(count, c.least);
  EXPECT_LE(count, c.most);
}

INSTANTIATE_TEST_SUITE_P(Scenes, TriangleCounts,
                         testing::Values(Counted{"cornell_30", 30, 30},
                                         Counted{"cornell_layers", 60, 60},
                                         Counted{"spheres_and_cube", 478, 478},
                                         Counted{"toys", 3426, 3426}, Counted{"teddy", 3500, 3570},
                                         Counted{"jeep", 3998, 3998},
                                         Counted{"cornell_lucy", 100'000, 110'000},
                                         Counted{"octagon_textured", 20'000, 25'000},
                                         Counted{"atrium", 150'000, 250'000}),
                         [](const auto& tested) { return std::string(tested.param.scene); });

struct Solid {
  const char* scene;
  const char* node;
  const char* test;
};

void PrintTo(const Solid& s, std::ostream* out) {
  *out << s.scene << "'s " << s.node;
}

class Solids : public testing::TestWithParam<Solid> {};

/// Every edge has exactly two triangles, which run along it in opposite directions, even across
/// charts.
TEST_P(Solids, AreClosedAndFaceOutwards) {
  using Point = std::array<float, 3>;
  struct Edge {
    int uses = 0, balance = 0;
  };
  std::map<std::pair<Point, Point>, Edge> edges;
  const auto triangles = only(triangles_of(generate(GetParam().scene)), GetParam().node);
  ASSERT_FALSE(triangles.empty());
  for (const Triangle& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const math::Vec3 a = t.position[k], b = t.position[(k + 1) % 3];
      const Point p{a.x, a.y, a.z}, q{b.x, b.y, b.z};
      Edge& edge = edges[std::minmax(p, q)];
      ++edge.uses;
      edge.balance += p < q ? 1 : -1;
    }
  EXPECT_EQ(edges.size(), triangles.size() * 3 / 2);
  for (const auto& [ends, edge] : edges) {
    ASSERT_EQ(edge.uses, 2) << ends.first[0] << ", " << ends.first[1] << ", " << ends.first[2];
    ASSERT_EQ(edge.balance, 0);
  }
  EXPECT_GT(six_volumes(triangles), 0);
}

INSTANTIATE_TEST_SUITE_P(Scenes, Solids,
                         testing::Values(Solid{"cornell_lucy", "statue", "statue"},
                                         Solid{"cornell_geom", "sphere", "sphere"},
                                         Solid{"cornell_geom", "torus", "torus"},
                                         Solid{"cornell_layers", "upper layer", "layer"},
                                         Solid{"spheres_and_cube", "red sphere", "red_sphere"},
                                         Solid{"spheres_and_cube", "cube", "cube"},
                                         Solid{"teddy", "bear", "bear"},
                                         Solid{"teddy", "bottle", "bottle"},
                                         Solid{"toys", "bear", "small_bear"},
                                         Solid{"octagon_textured", "serpent", "serpent"},
                                         Solid{"jeep", "fenders", "fenders"}),
                         [](const auto& tested) { return std::string(tested.param.test); });

TEST(ThesisScenes, TheStatueStandsOnItsPlinthUnderTheLamp) {
  const auto all = triangles_of(generate("cornell_lucy"));
  const Bounds statue = bounds_of(only(all, "statue")), lamp = bounds_of(only(all, "lamp")),
               plinth = bounds_of(only(all, "plinth")), room = bounds_of(only(all, "room"));
  EXPECT_NEAR(statue.low.y, plinth.high.y, 0.002);
  EXPECT_LE(statue.low.y, plinth.high.y) << "it floats";
  EXPECT_NEAR(statue.high.y - statue.low.y, 3.62, 0.05);
  EXPECT_LT(statue.high.y, lamp.low.y);
  EXPECT_GT(lamp.high.x - lamp.low.x, 3) << "a large lamp";
  for (const int axis : {0, 2}) {
    EXPECT_GT(statue.low[axis], room.low[axis]);
    EXPECT_LT(statue.high[axis], room.high[axis]);
  }
}

TEST(ThesisScenes, DetailSetsTheStatuesTriangles) {
  EXPECT_EQ(only(triangles_of(generate("cornell_lucy", 4)), "statue").size(), 1072u * 4 * 4);
}

TEST(ThesisScenes, ThingsHaveTheirRealSizes) {
  const Bounds bear = bounds_of(only(triangles_of(generate("teddy")), "bear"));
  EXPECT_NEAR(bear.high.y - bear.low.y, 0.62, 0.02);
  const Bounds tires = bounds_of(only(triangles_of(generate("jeep")), "tires"));
  EXPECT_NEAR(tires.low.y, 0, 1e-5) << "the wheels stand on the ground";
  const Bounds lamp = bounds_of(only(triangles_of(generate("cornell_geom")), "lamp"));
  EXPECT_NEAR(lamp.high.z - lamp.low.z, 0.05, 1e-5) << "a narrow lamp";
  const Bounds atrium = bounds_of(triangles_of(generate("atrium")));
  EXPECT_NEAR(atrium.high.y, 10, 1e-5);
}

TEST(ThesisScenes, EveryBrickOfTheOctagonHasATexture) {
  const nlohmann::json document = generate("octagon_textured").document;
  for (const auto& m : document["materials"]) {
    const bool lamp = m["name"].get<std::string>().starts_with("lamp");
    EXPECT_EQ(m["pbrMetallicRoughness"].contains("baseColorTexture"), !lamp) << m["name"];
  }
}

}  // namespace
}  // namespace kiln::generate
