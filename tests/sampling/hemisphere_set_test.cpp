#include "baker/sampling/hemisphere_set.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "baker/sampling/empty_circle.h"
#include "baker/sampling/estimate.h"
#include "baker/sampling/shapes.h"
#include "baker/sampling/sobol.h"

namespace kiln::sampling {
namespace {

using math::Vec2d;

double distance_to(const std::vector<Vec2d>& points, std::size_t count, Vec2d p) {
  double square = 1e9;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec2d d = points[i] - p;
    square = std::min(square, dot(d, d));
  }
  return std::sqrt(square);
}

Vec2d random_in_disc(std::uint32_t key) {
  const double r = std::sqrt(hash(key, 1) * 0x1p-32), angle = 2 * M_PI * hash(key, 2) * 0x1p-32;
  return {r * std::cos(angle), r * std::sin(angle)};
}

struct Weighted {
  Vec2d point;
  double weight;
};

/// Root mean square, over many circles, of the difference between the share of the points that lies
/// in a circle and the circle's share of the disc.
double discrepancy(const std::vector<Weighted>& points) {
  constexpr std::uint32_t kCircles = 400, kSamples = 4000;
  std::vector<Vec2d> even;
  for (std::uint32_t i = 0; i < kSamples; ++i) {
    const SobolPoint p = sobol(i);
    const double r = std::sqrt(p.x * 0x1p-32), angle = 2 * M_PI * p.y * 0x1p-32;
    even.push_back({r * std::cos(angle), r * std::sin(angle)});
  }
  double square = 0;
  for (std::uint32_t c = 0; c < kCircles; ++c) {
    const Vec2d center = random_in_disc(hash(77, c));
    const double radius = 0.2 + 0.6 * hash(78, c) * 0x1p-32;
    double off = 0;
    for (const Weighted& p : points) off += length(p.point - center) < radius ? p.weight : 0;
    for (const Vec2d p : even) off -= length(p - center) < radius ? 1. / kSamples : 0;
    square += off * off / kCircles;
  }
  return std::sqrt(square);
}

TEST(EmptyCircle, PointsLieInTheDiscAndAreThoseOfTheSeed) {
  const auto points = largest_empty_circle_points(4096, 7);
  ASSERT_EQ(points.size(), 4096u);
  for (const Vec2d p : points) EXPECT_LE(length(p), 1 + 1e-12);
  EXPECT_EQ(points, largest_empty_circle_points(4096, 7));
  const auto few = largest_empty_circle_points(100, 7);
  EXPECT_TRUE(std::equal(few.begin(), few.end(), points.begin())) << "any prefix is a set";
  EXPECT_NE(few, largest_empty_circle_points(100, 8));
  EXPECT_TRUE(largest_empty_circle_points(0, 7).empty());
}

// By brute force: no point of a fine grid is farther from the points so far than the next one is.
// The first few are left out, where a point of the border may be the farthest of its own cell.
TEST(EmptyCircle, EachPointIsTheCenterOfTheLargestEmptyCircle) {
  constexpr int kGrid = 150;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const auto points = largest_empty_circle_points(120, seed);
    for (std::size_t n = 8; n < points.size(); ++n) {
      const double mine = distance_to(points, n, points[n]);
      for (int y = -kGrid; y <= kGrid; ++y)
        for (int x = -kGrid; x <= kGrid; ++x) {
          const Vec2d p{double(x) / kGrid, double(y) / kGrid};
          if (dot(p, p) <= 1) {
            ASSERT_LE(distance_to(points, n, p), mine + 1e-9) << seed << " " << n;
          }
        }
    }
  }
}

TEST(EmptyCircle, AnyPrefixIsSpreadEvenly) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const auto points = largest_empty_circle_points(1024, seed);
    std::vector<Vec2d> random;
    for (std::uint32_t i = 0; i < 1024; ++i) random.push_back(random_in_disc(hash(79, i)));
    for (const std::size_t n : {50u, 100u, 256u, 300u, 777u, 1024u}) {
      double nearest = 9;
      for (std::size_t i = 0; i < n; ++i)
        nearest = std::min(nearest, distance_to(points, i, points[i]));
      // Of n points of a regular lattice each is 1.9 / √n from the next; random ones come as near
      // as 1 / n.
      EXPECT_GT(nearest * std::sqrt(double(n)), 1.4) << seed << " " << n;
      EXPECT_LT(nearest * std::sqrt(double(n)), 2) << seed << " " << n;
      // Weighted by its cells it is even in area, too.
      const auto weighted = [&](DiscRule rule) {
        const HemisphereSet set = disc_directions(std::uint32_t(n), seed, rule);
        std::vector<Weighted> all;
        for (std::uint32_t i = 0; i < n; ++i)
          all.push_back({{double(set.x[i]), double(set.y[i])}, double(set.weight[i])});
        return discrepancy(all);
      };
      std::vector<Weighted> chance, net;
      for (std::uint32_t i = 0; i < n; ++i) {
        chance.push_back({random[i], 1 / double(n)});
        const math::Vec3 d = cosine_direction(scrambled(sobol(i), std::uint32_t(seed)));
        net.push_back({{double(d.x), double(d.y)}, 1 / double(n)});
      }
      EXPECT_LT(weighted(DiscRule::kCells), 0.35 * discrepancy(chance)) << seed << " " << n;
      const auto note = [&](const char* name, double value) {
        RecordProperty(std::to_string(n) + name + std::to_string(seed),
                       std::to_string(100 * value));
      };
      note("_cells_", weighted(DiscRule::kCells)), note("_net_", discrepancy(net));
      note("_printed_", weighted(DiscRule::kAsPrinted)), note("_random_", discrepancy(chance));
      if (n >= 256) {
        EXPECT_LT(weighted(DiscRule::kCells), 0.5 * weighted(DiscRule::kAsPrinted))
            << seed << " " << n;
      }
    }
  }
}

TEST(EmptyCircle, CellsCoverTheDisc) {
  for (const std::uint32_t n : {1u, 2u, 3u, 5u, 40u, 1000u}) {
    const auto cells = voronoi_cells(largest_empty_circle_points(n, 5));
    ASSERT_EQ(cells.size(), n);
    double sum = 0;
    Vec2d mean{0, 0};
    for (const DiscCell& c : cells) {
      EXPECT_GT(c.share, (n < 40 ? 0.1 : 0.3) / n);
      EXPECT_LT(length(c.centroid), 1);
      sum += c.share, mean = mean + c.centroid * c.share;
    }
    EXPECT_NEAR(sum, 1, 1e-12);
    EXPECT_NEAR(length(mean), 0, 2e-3) << "of all, the centroid is the disc's middle";
  }
  // By counting: the nearest of five points.
  const auto points = largest_empty_circle_points(5, 9);
  const auto cells = voronoi_cells(points);
  std::vector<double> count(5);
  constexpr std::uint32_t kSamples = 100000;
  for (std::uint32_t i = 0; i < kSamples; ++i) {
    const Vec2d p = random_in_disc(hash(80, i));
    std::size_t best = 0;
    for (std::size_t k = 1; k < 5; ++k)
      if (length(points[k] - p) < length(points[best] - p)) best = k;
    count[best] += 1. / kSamples;
  }
  for (std::size_t k = 0; k < 5; ++k) EXPECT_NEAR(count[k], cells[k].share, 0.006);
}

double mean_cosine(const HemisphereSet& set) {
  double sum = 0;
  for (std::uint32_t i = 0; i < set.size(); ++i) sum += double(set.weight[i]) * double(set.z[i]);
  return sum;
}

void expect_sound(const HemisphereSet& set) {
  double sum = 0, first = 0, second = 0;
  for (std::uint32_t i = 0; i < set.size(); ++i) {
    const math::Vec3 d{set.x[i], set.y[i], set.z[i]};
    EXPECT_NEAR(length(d), 1, 1e-6);
    EXPECT_GT(d.z, 0);
    EXPECT_GT(set.weight[i], 0);
    sum += double(set.weight[i]);
    (set.contrast[i] > 0 ? first : second) += double(set.contrast[i]);
  }
  EXPECT_NEAR(sum, 1, 1e-5);
  EXPECT_NEAR(first, -second, 1e-5) << "of the same light, halves have the same estimate";
  EXPECT_GT(first, 0.1);
}

// Of cosine-distributed directions the mean cosine is 2/3. Those that stand for a whole cell have a
// little more, since the cosine is concave on the disc and steep at its border.
TEST(HemisphereSet, PointsOfTheDiscHaveTheDensityOfTheCosine) {
  for (const std::uint64_t seed : {1u, 2u, 3u})
    for (const std::uint32_t n : {64u, 256u, 1000u, 4096u}) {
      const HemisphereSet set = disc_directions(n, seed, DiscRule::kCells);
      ASSERT_EQ(set.size(), n);
      expect_sound(set);
      EXPECT_GT(mean_cosine(set), 2. / 3);
      EXPECT_LT(mean_cosine(set), 2. / 3 + 0.4 * std::pow(n, -0.75)) << seed << " " << n;
      // As RTRad prints it, points on the border weigh too much.
      EXPECT_LT(mean_cosine(disc_directions(n, seed, DiscRule::kAsPrinted)),
                2. / 3 - 0.5 / std::sqrt(n));
    }
}

TEST(HemisphereSet, CellsOfTheHemicubeWeighAsTheirViewFactors) {
  for (const auto& [asked, cells] :
       {std::pair(1u, 12u), std::pair(64u, 48u), std::pair(256u, 300u), std::pair(1024u, 972u)}) {
    const HemisphereSet set = hemicube_directions(asked);
    EXPECT_EQ(set.size(), cells);
    expect_sound(set);
    EXPECT_NEAR(mean_cosine(set), 2. / 3, 0.7 / cells + 1e-4) << cells;
  }
  // The top of the cube, which reaches to 45 degrees along the axes: F = 0.5541 [Howell, C-11 with
  // a point in the middle: 4/π (x/√(1+x²)) atan(x/√(1+x²)) at x = 1].
  const HemisphereSet fine = hemicube_directions(3 * 64 * 64);
  double top = 0;
  for (std::uint32_t i = 0; i < fine.size(); ++i)
    top +=
        std::max(std::abs(fine.x[i]), std::abs(fine.y[i])) < fine.z[i] ? double(fine.weight[i]) : 0;
  EXPECT_NEAR(top, 4 / M_PI * std::sqrt(0.5) * std::atan(std::sqrt(0.5)), 1e-3);
}

// Half the difference of two sets of half as many points, the first of which is the set of so many.
TEST(HemisphereSet, ContrastIsHalfTheDifferenceOfTwoHalves) {
  for (const DiscRule rule : {DiscRule::kCells, DiscRule::kAsPrinted}) {
    const HemisphereSet all = disc_directions(101, 3, rule), half = disc_directions(51, 3, rule);
    for (std::uint32_t i = 0; i < 51; ++i)
      EXPECT_NEAR(all.contrast[i], half.weight[i] / 2 * kDiscCorrection, 1e-7);
    for (std::uint32_t i = 51; i < 101; ++i) EXPECT_LT(all.contrast[i], 0);
  }
}

}  // namespace
}  // namespace kiln::sampling
