// Radiosity over pairs of texels: its view factors, and the light that they lead to.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "baker/solver/pairwise/parts.h"
#include "tests/solver/cornell_box.h"
#include "tests/support/quad_scene.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver::pairwise {
namespace {

proto::SolverSettings settings_for(proto::Method method, std::uint32_t pair_samples = 1) {
  proto::SolverSettings s;
  s.method = method;
  s.pair_samples = pair_samples;
  s.direct_samples = 64;
  return s;
}

constexpr std::array kMethods{proto::Method::kPairwise, proto::Method::kMatrix};

/// A scene with all that view factors need.
struct Ready {
  const QuadScene& scene;
  trace::RayScene rays;
  light::LightSet lights;
  trace::TexelLookup lookup;
  World world;
  Parts parts;

  Ready(const QuadScene& s, const proto::SolverSettings& settings)
      : scene(s),
        rays(test::must(trace::RayScene::build(s.scene()))),
        lights(s.scene()),
        lookup(s.scene(), s.atlas(), s.texels()),
        world{s.scene(), s.atlas(), s.texels(), rays,
              lights,    lookup,    settings,   baker::sample_plan(settings, {})},
        parts(world) {}

  /// One row of F; zero where nothing is seen.
  std::vector<float> row(std::uint32_t i) const {
    std::vector<float> f(parts.patches.size());
    const std::vector<math::Rgb> unit(f.size(), {1, 1, 1});
    const auto senders = parts.senders.pick(unit, 0, {});
    parts.factors.row(i, *senders, nullptr,
                      [&](std::uint32_t s, float factor) { f[senders->list[s].texel] = factor; });
    return f;
  }
};

double area_mean(const QuadScene& scene, const std::vector<std::uint32_t>& texels,
                 const std::function<double(std::uint32_t)>& value) {
  double sum = 0, area = 0;
  for (const std::uint32_t t : texels) {
    sum += double(scene.texels().area_m2[t]) * value(t);
    area += double(scene.texels().area_m2[t]);
  }
  return sum / area;
}

// Closed forms. One plate is lit by a sun that the other turns its back or its edge to; what the
// other gets is the one bounce between them: E = ρ E_sun F.
constexpr float kAlbedo = 0.5f;
const Quad kFloor{{0, 0, 0}, {0, 0, 1}, {1, 0, 0}};

struct Plates {
  QuadScene scene;
  std::uint32_t receiver = 0, lit = 0;
  double sun = 0;  ///< lx on the plate that is lit

  Plates(std::uint32_t texels, const Quad& to, Quad from, math::Vec3 sunlight)
      : scene(2 * (texels + 4)) {
    receiver = scene.add(to);
    from.albedo = {kAlbedo, kAlbedo, kAlbedo};
    lit = scene.add(from);
    scene.build();
    scene::PunctualLight light;
    light.type = scene::PunctualType::kDirectional;
    light.direction = normalize(sunlight);
    light.intensity = {5, 5, 5};
    scene.scene().lights = {light};
    sun = -5 * double(dot(light.direction, normalize(cross(from.edge_u, from.edge_v))));
  }
  double view_factor(proto::SolverSettings s) const {
    s.bounces = 1;
    const Solution solution = scene.solve(s);
    return area_mean(scene, scene.texels_of(receiver),
                     [&](auto t) { return double(solution.light->indirect[t].g); }) /
           (double(kAlbedo) * sun);
  }
};

// Two parallel unit squares at distance 1: F = 0.199824896 [Howell, configuration C-11]. The rule
// of middles errs by at most h²/24 of the sum of the kernel's second derivatives over its four
// dimensions; each is at most 4/π in size, at r = 1.
TEST(ViewFactor, ParallelSquares) {
  for (const std::uint32_t texels : {12u, 24u}) {
    const Plates plates(texels, kFloor, {{0, 1, 0}, {1, 0, 0}, {0, 0, 1}}, {1.2f, 1, 0});
    const double h = 1.0 / texels;
    for (const proto::Method method : kMethods)
      EXPECT_NEAR(plates.view_factor(settings_for(method)), 0.199824896,
                  h * h / 24 * 4 * 4 / double(math::kPi) + 2e-4 * 0.2)
          << texels;
  }
}

// Two unit squares at a right angle with a common edge: F = 0.200043776 [Howell, C-14]. Along the
// edge r falls to h/√2 whatever the texel's width h is, so by the formula alone each texel there
// errs by the same share, and all together by a share that falls with h: half the width, half the
// error. The mean over all pairs of points has next to none of it.
TEST(ViewFactor, PerpendicularSquares) {
  const auto error = [](std::uint32_t texels, std::uint32_t pair_samples, bool near_field) {
    const Plates plates(texels, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, kFloor, {0, -1, 0});
    proto::SolverSettings s = settings_for(proto::Method::kPairwise, pair_samples);
    s.near_field = near_field;
    return plates.view_factor(s) - 0.200043776;
  };
  const double coarse = error(8, 1, false), middle = error(16, 1, false),
               fine = error(32, 1, false);
  const double many_points = error(8, 256, false);
  EXPECT_GT(coarse, 0) << "near texels are overstated";
  EXPECT_NEAR(middle / coarse, 0.5, 0.06);
  EXPECT_NEAR(fine / middle, 0.5, 0.06);
  // More points of a texel are what smaller texels are [RTRad 4.7.2].
  EXPECT_LT(std::abs(many_points), coarse / 2);
  const double near = error(8, 1, true), near_fine = error(32, 1, true);
  RecordProperty("errors", std::to_string(coarse) + ", " + std::to_string(middle) + ", " +
                               std::to_string(fine) + "; " + std::to_string(many_points) +
                               "; near field " + std::to_string(near) + ", " +
                               std::to_string(near_fine));
  EXPECT_LT(std::abs(near), coarse / 10);
  EXPECT_LT(std::abs(near_fine), fine / 5);
}

TEST(ViewFactor, IsReciprocalBitForBit) {
  for (const std::uint32_t samples : {1u, 16u}) {
    const auto box = cornell(32);
    const Ready ready(*box, settings_for(proto::Method::kPairwise, samples));
    const std::uint32_t n = ready.parts.patches.size();
    std::vector<std::vector<float>> rows;
    for (std::uint32_t i = 0; i < n; ++i) rows.push_back(ready.row(i));
    std::uint32_t seen = 0, blocked = 0;
    for (std::uint32_t i = 0; i < n; ++i) {
      // What comes of tracing a pair once is what comes of tracing it from either side.
      std::vector<float> forth(n), back(n);
      ready.parts.factors.pairs(i, i + 1, n, [&](std::uint32_t j, ViewFactors::Factors f) {
        forth[j] = f.forth, back[j] = f.back;
      });
      for (std::uint32_t j = i + 1; j < n; ++j) {
        ASSERT_EQ(forth[j], rows[i][j]) << i << " " << j;
        ASSERT_EQ(back[j], rows[j][i]) << i << " " << j;
        const float a_i = ready.parts.patches.area_m2(i), a_j = ready.parts.patches.area_m2(j);
        // Interpolated normals are those of the surface but for rounding.
        ASSERT_NEAR(a_i * rows[i][j], a_j * rows[j][i], 1e-6f * std::min(a_i, a_j));
        seen += rows[i][j] > 0, blocked += rows[i][j] == 0;
      }
    }
    EXPECT_GT(seen, n);
    EXPECT_GT(blocked, n);
  }
}

// The samples of a pair are pairs of points that differ, and the same from either side.
TEST(Patches, SamplesOfAPairAreDifferentPairsOfPoints) {
  const auto box = cornell(32);
  const Ready ready(*box, settings_for(proto::Method::kPairwise, 256));
  const Patches& patches = ready.parts.patches;
  for (const auto& [a, b] : {std::pair(3u, 40u), std::pair(7u, 90u)}) {
    std::vector<int> met(256);
    ASSERT_EQ(patches.pair_key(a, b), patches.pair_key(b, a));
    const std::uint32_t key = patches.pair_key(a, b);
    for (std::uint32_t k = 0; k < 256; ++k) {
      const Patches::Ends e = patches.ends(a, b, key, k), mirrored = patches.ends(b, a, key, k);
      EXPECT_EQ(e.receiver, mirrored.sender);
      EXPECT_EQ(e.sender, mirrored.receiver);
      ++met[16 * e.receiver + e.sender];
      if (k % 16 == 15) {
        for (std::uint32_t p = 0; p < 16; ++p) {
          int as_receiver = 0;
          for (std::uint32_t q = 0; q < 16; ++q) as_receiver += met[16 * p + q];
          EXPECT_EQ(as_receiver, int(k / 16 + 1));
        }
      }
    }
    for (const int times : met) EXPECT_EQ(times, 1);
  }
}

// A window leaves out neighbors on the same chart, and no others.
TEST(Patches, WindowLeavesOutNeighborsOfTheChart) {
  const auto box = cornell(64);
  proto::SolverSettings s = settings_for(proto::Method::kPairwise);
  const auto excluded = [&](std::uint32_t a) {
    const Ready ready(*box, s);
    std::uint32_t count = 0;
    for (std::uint32_t b = 0; b < box->texels().size(); ++b) {
      const bool is = ready.parts.patches.are_excluded(a, b);
      count += is;
      EXPECT_EQ(is, ready.parts.patches.are_excluded(b, a));
      if (is) {
        EXPECT_EQ(box->texels().chart[a], box->texels().chart[b]);
      }
    }
    return count;
  };
  const auto quad = box->texels_of(0);
  const auto middle = *std::ranges::find_if(quad, [&](std::uint32_t t) {
    const auto has = [&](int x, int y) {
      return box->texels().neighbor(t, x, y) != atlas::kNoTexel;
    };
    return has(2, 2) && has(-2, -2);
  });
  EXPECT_EQ(excluded(middle), 1u) << "itself: 64 / 128 is less than a texel";
  s.window = 2;
  EXPECT_EQ(excluded(middle), 9u);
  s.window = 3;
  EXPECT_EQ(excluded(middle), 25u);
  // Neighbors on one flat chart do not see each other anyway.
  s.window = 1;
  const Solution narrow = box->solve(s);
  s.window = 256;
  EXPECT_TRUE(same_bits(narrow.light->indirect, box->solve(s).light->indirect));
}

TEST(ViewFactor, FactorsOfTheSettings) {
  const auto box = cornell(64);
  for (const proto::Method method : kMethods) {
    proto::SolverSettings s = settings_for(method);
    s.reflectivity_factor = 0;
    const Solution black = box->solve(s);
    for (const math::Rgb& e : black.light->indirect) ASSERT_TRUE(is_black(e));
  }
  proto::SolverSettings s = settings_for(proto::Method::kPairwise);
  s.bounces = 1;
  const Solution whole = box->solve(s);
  s.reflectivity_factor = 0.5f;
  const Solution half = box->solve(s);
  s.reflectivity_factor = 1;
  s.distance_factor = 2;
  const Solution far = box->solve(s);
  std::uint32_t held_down = 0;
  for (std::uint32_t t = 0; t < box->texels().size(); ++t) {
    const float e = whole.light->indirect[t].g, quarter = far.light->indirect[t].g;
    EXPECT_NEAR(half.light->indirect[t].g, e / 2, 1e-6f * e);
    // A factor that is held down to its limit is so no more at twice the distance.
    EXPECT_GE(quarter, e / 4 - 1e-6f * e);
    held_down += quarter > e / 4 + 1e-6f * e;
  }
  EXPECT_LT(held_down, box->texels().size() / 100);
}

// Furnace: all faces of a closed room emit M and reflect ρ. The light is what the rule's own view
// factors give, taken here by a sum in double precision over the middles of the texels.
class RoomOfLight {
 public:
  static constexpr double kEmittance = 0.5 * 3.14159265358979;

  RoomOfLight(std::uint32_t page, float albedo) : room_(page), albedo_(double(albedo)) {
    room_.add_room({-1, 0, -1}, {1, 2, 1}, {albedo, albedo, albedo}, {0.5f, 0.5f, 0.5f});
    room_.build();
  }
  const QuadScene& scene() const { return room_; }
  std::vector<std::uint32_t> all() const {
    std::vector<std::uint32_t> t(room_.texels().size());
    for (std::uint32_t i = 0; i < t.size(); ++i) t[i] = i;
    return t;
  }

  double view_factor(std::uint32_t i, std::uint32_t j) const {
    const atlas::TextureGroup& t = room_.texels();
    double way[3], r2 = 0, at_i = 0, at_j = 0;
    for (int c = 0; c < 3; ++c) {
      way[c] = double(t.position[j][c]) - double(t.position[i][c]);
      r2 += way[c] * way[c];
      at_i += way[c] * double(t.shading_normal[i][c]);
      at_j -= way[c] * double(t.shading_normal[j][c]);
    }
    if (at_i < 1e-6 || at_j < 1e-6) return 0;
    return double(t.area_m2[j]) * at_i * at_j / (double(math::kPi) * r2 * r2);
  }
  /// The light of so many bounces of this direct light.
  std::vector<double> expected(const lightmap::Lightmap& light, int bounces) const {
    const std::uint32_t n = room_.texels().size();
    std::vector<double> f(std::size_t(n) * n), direct(n);
    for (std::uint32_t i = 0; i < n; ++i) {
      direct[i] = double(light.direct[i].g);
      for (std::uint32_t j = 0; j < n; ++j)
        if (i != j) f[std::size_t(i) * n + j] = view_factor(i, j);
    }
    std::vector<double> e = direct;
    for (int b = 0; b < bounces; ++b) {
      std::vector<double> next = direct;
      for (std::uint32_t i = 0; i < n; ++i)
        for (std::uint32_t j = 0; j < n; ++j) next[i] += f[std::size_t(i) * n + j] * albedo_ * e[j];
      e = next;
    }
    return e;
  }

 private:
  QuadScene room_;
  double albedo_;
};

TEST(PairwiseFurnace, IsTheSumOfItsViewFactors) {
  for (const float albedo : {0.5f, 0.8f}) {
    const RoomOfLight room(32, albedo);
    proto::SolverSettings s = settings_for(proto::Method::kPairwise);
    s.bounces = 6;
    s.tolerance = 0;
    s.near_field = false;
    const Solution pairwise = room.scene().solve(s);
    s.method = proto::Method::kMatrix;
    const Solution matrix = room.scene().solve(s);
    const auto cut = room.expected(*pairwise.light, 6), whole = room.expected(*matrix.light, 200);
    for (const std::uint32_t t : room.all()) {
      EXPECT_NEAR(pairwise.light->irradiance(t).g, cut[t], 1e-5 * cut[t]) << t;
      EXPECT_NEAR(matrix.light->irradiance(t).g, whole[t], 1e-5 * whole[t]) << t;
    }
  }
}

// Towards M/(1-ρ) [Moreno-Fortuny eq. 2.15 with rows of F that sum to 1]. What the formula
// overstates lies along the edges of the room: with texels half as wide it is half as much. The
// near field has next to none of it.
TEST(PairwiseFurnace, GoesToEmittanceOverAbsorptance) {
  for (const bool near_field : {false, true}) {
    double last = 0;
    for (const std::uint32_t texels : {6u, 12u, 24u}) {
      const RoomOfLight room(3 * (texels + 4), 0.5f);
      proto::SolverSettings s = settings_for(proto::Method::kMatrix);
      s.near_field = near_field;
      const Solution solution = room.scene().solve(s);
      const auto mean = [&](const std::function<double(std::uint32_t)>& value) {
        return area_mean(room.scene(), room.all(), value);
      };
      const double direct = mean([&](auto t) { return double(solution.light->direct[t].g); });
      EXPECT_NEAR(direct, RoomOfLight::kEmittance, 0.01 * RoomOfLight::kEmittance);
      const double whole = mean([&](auto t) { return double(solution.light->irradiance(t).g); });
      const double error = whole / (direct / (1 - 0.5)) - 1;
      RecordProperty("error_percent_" + std::to_string(texels) + (near_field ? "_near" : ""),
                     std::to_string(100 * error));
      if (near_field) {
        EXPECT_LT(std::abs(error), 0.01);
        continue;
      }
      EXPECT_GT(error, 0);
      if (last > 0) {
        EXPECT_NEAR(error / last, 0.5, 0.1);
      }
      last = error;
    }
  }
}

// A room that a slanting wall parts from edge to edge: a lamp on the one side leaves the other one
// exactly dark, along all edges, whatever points are taken.
TEST(PairwiseLeaks, ASealedWedgeStaysDark) {
  QuadScene room(36);
  const math::Rgb gray{0.7f, 0.7f, 0.7f};
  // The cross section is a square of 2 m, cut along its diagonal; z from -1 to 1.
  const auto half = [&](bool upper) {
    std::vector<std::uint32_t> quads;
    const math::Vec3 z{0, 0, 2};
    if (upper) {
      quads.push_back(room.add({{-1, 2, -1}, {2, 0, 0}, z, gray}));  // ceiling
      quads.push_back(room.add({{-1, 0, -1}, {0, 2, 0}, z, gray}));  // left wall
      quads.push_back(room.add({{-1, 0, -1}, z, {2, 2, 0}, gray}));  // the slanting wall
    } else {
      quads.push_back(room.add({{-1, 0, -1}, z, {2, 0, 0}, gray}));  // floor
      quads.push_back(room.add({{1, 0, -1}, z, {0, 2, 0}, gray}));   // right wall
      quads.push_back(room.add({{-1, 0, -1}, {2, 2, 0}, z, gray}));  // its other face
    }
    return quads;
  };
  const auto bright = half(true), dark = half(false);
  // The ends are whole squares, which both halves share: black, so that they pass nothing on.
  room.add({{-1, 0, -1}, {2, 0, 0}, {0, 2, 0}});
  room.add({{-1, 0, 1}, {0, 2, 0}, {2, 0, 0}});
  room.build();
  scene::PunctualLight lamp;
  lamp.position = {-0.5f, 1.5f, 0};
  lamp.intensity = {1e4f, 1e4f, 1e4f};
  room.scene().lights = {lamp};
  for (const proto::Method method : kMethods)
    for (const std::uint32_t samples : {1u, 16u}) {
      proto::SolverSettings s = settings_for(method, samples);
      s.bounces = 4;
      const Solution solution = room.solve(s);
      for (const std::uint32_t quad : dark)
        for (const std::uint32_t t : room.texels_of(quad))
          ASSERT_TRUE(is_black(solution.light->irradiance(t)))
              << proto::to_string(method) << " " << samples << " quad " << quad << " texel " << t;
      for (const std::uint32_t quad : bright)
        for (const std::uint32_t t : room.texels_of(quad))
          ASSERT_GT(solution.light->indirect[t].g, 0);
    }
}

// What a lamp gives is absorbed in the end, but for what rows of F sum to more or less than 1:
// Σ A (1-ρ) E = Σ A E_direct + Σ A_j B_j (Σ_k F_jk - 1), by reciprocity, in each channel.
TEST(PairwiseEnergy, ClosedBoxAbsorbsWhatItsViewFactorsSay) {
  QuadScene room(48);
  room.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
  room.add_block({-0.5f, 0.2f, -0.3f}, {0.1f, 0.9f, 0.2f}, {0.2f, 0.6f, 0.5f}, true);
  room.build();
  scene::PunctualLight lamp;
  lamp.position = {0.5f, 1.5f, 0.3f};
  lamp.intensity = {100, 100, 100};
  room.scene().lights = {lamp};
  for (const std::uint32_t samples : {1u, 16u}) {
    const proto::SolverSettings s = settings_for(proto::Method::kMatrix, samples);
    const Solution solution = room.solve(s);
    const Ready ready(room, s);
    const atlas::TextureGroup& t = room.texels();
    double absorbed[3] = {}, direct[3] = {}, gained[3] = {};
    for (std::uint32_t i = 0; i < t.size(); ++i) {
      double row = 0;
      for (const float f : ready.row(i)) row += double(f);
      const math::Rgb e = solution.light->irradiance(i), d = solution.light->direct[i];
      const double area = t.area_m2[i], es[3] = {e.r, e.g, e.b}, ds[3] = {d.r, d.g, d.b},
                   rho[3] = {t.albedo[i].r, t.albedo[i].g, t.albedo[i].b};
      for (int c = 0; c < 3; ++c) {
        absorbed[c] += area * (1 - rho[c]) * es[c];
        direct[c] += area * ds[c];
        gained[c] += area * rho[c] * es[c] * (row - 1);
      }
    }
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(absorbed[c], direct[c] + gained[c], 1e-5 * direct[c]) << c;
      RecordProperty("gained_percent_" + std::to_string(samples) + "_" + std::to_string(c),
                     std::to_string(100 * gained[c] / direct[c]));
    }
    // A point lamp in a closed room of 4π · 100 lm, but for what the block's middles miss.
    EXPECT_NEAR(direct[0], 400 * double(math::kPi), 0.02 * 400 * double(math::kPi));
  }
}

// Bounces to the end of the series are the solution of the system.
TEST(PairwiseMatrix, IsTheLimitOfTheBounces) {
  const auto box = cornell(64);
  for (const std::uint32_t samples : {1u, 4u}) {
    proto::SolverSettings s = settings_for(proto::Method::kPairwise, samples);
    s.bounces = 48;                              // each brings some two thirds of the one before
    s.visibility = proto::VisibilityKind::kRay;  // rays are counted
    s.tolerance = 0;
    const Solution bounced = box->solve(s);
    EXPECT_GE(bounced.passes.size(), 40u) << "they end sooner only where no bit changes any more";
    s.method = proto::Method::kMatrix;
    const Solution solved = box->solve(s);
    ASSERT_EQ(solved.passes.size(), 2u);
    // Each pair is traced once, in place of twice in every bounce, where only the black lamp is
    // left out.
    EXPECT_LE(bounced.passes.back().rays, 2 * solved.passes.back().rays);
    EXPECT_GT(bounced.passes.back().rays, 1.8 * double(solved.passes.back().rays));
    for (std::uint32_t t = 0; t < box->texels().size(); ++t) {
      const math::Rgb a = bounced.light->indirect[t], b = solved.light->indirect[t];
      EXPECT_NEAR(a.r, b.r, 2e-6f * b.r);
      EXPECT_NEAR(a.g, b.g, 2e-6f * b.g);
      EXPECT_NEAR(a.b, b.b, 2e-6f * b.b);
    }
  }
}

TEST(PairwiseBounces, EndAtTheToleranceWithACompleteLight) {
  const auto box = cornell(32);
  proto::SolverSettings s = settings_for(proto::Method::kPairwise);
  s.bounces = 64;
  const Solution solution = box->solve(s);
  const auto& passes = solution.passes;
  ASSERT_GT(passes.size(), 4u);
  ASSERT_LT(passes.size(), 30u);
  EXPECT_TRUE(passes.back().standard_error.has_value());
  EXPECT_GT(passes[passes.size() - 2].residual * 0.7, s.tolerance) << "no bounce too many";
  s.method = proto::Method::kMatrix;
  const Solution exact = box->solve(s);
  for (std::uint32_t t = 0; t < box->texels().size(); ++t) {
    // Those left out change less than the tolerance each, and fall by half or so.
    const float e = exact.light->irradiance(t).g;
    EXPECT_NEAR(solution.light->irradiance(t).g, e, 4 * s.tolerance * e + 1e-3f * e);
  }
}

}  // namespace
}  // namespace kiln::solver::pairwise
