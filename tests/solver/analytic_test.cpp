// Closed forms against every method. Where sampling is involved, tolerances follow from the scatter
// between bakes with different seeds: with 8 seeds a deviation of kSigmas standard errors has a
// probability below 1e-4 (Student's t, 7 degrees of freedom), and the seeds are fixed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "baker/sampling/shapes.h"
#include "tests/solver/every_method.h"
#include "tests/support/quad_scene.h"

namespace kiln::solver {
namespace {

constexpr int kSeeds = 8;
constexpr double kSigmas = 8;
/// Rounding of float sums, and the offset of ray origins: what no number of samples removes.
constexpr double kRounding = 2e-4;

proto::SolverSettings settings_for(proto::Method method) {
  proto::SolverSettings s;
  s.method = method;
  s.samples = 64;
  s.direct_samples = 64;
  s.bounces = 0;
  // Points that are spread over the area of a near lamp bring fireflies, which a few seeds miss.
  s.light_sampling = proto::LightSampling::kSolidAngle;
  return s;
}

std::vector<std::uint32_t> all_texels(const QuadScene& scene) {
  std::vector<std::uint32_t> t(scene.texels().size());
  for (std::uint32_t i = 0; i < t.size(); ++i) t[i] = i;
  return t;
}

class EveryMethod : public testing::TestWithParam<proto::Method> {};
INSTANTIATE_TEST_SUITE_P(Methods, EveryMethod, testing::ValuesIn(all_methods()), method_name);

// Furnace: in a closed room whose faces all emit M = πL and reflect ρ, B = M/(1-ρ) everywhere, and
// so is E, for all of it arrives again [Moreno-Fortuny eq. 2.15 with rows of F that sum to 1].
// With b bounces the series is cut: E = M (1 - ρ^(b+1))/(1-ρ).
// Methods over pairs of texels err along edges: pairwise_test.cpp has their furnace.
class Furnace : public testing::TestWithParam<std::tuple<proto::Method, float>> {};
INSTANTIATE_TEST_SUITE_P(Methods, Furnace,
                         testing::Combine(testing::Values(proto::Method::kGather,
                                                          proto::Method::kPath),
                                          testing::Values(0.5f, 0.9f)));

TEST_P(Furnace, RadiosityIsEmittanceOverAbsorptance) {
  const auto [method, albedo] = GetParam();
  QuadScene room(32);
  room.add_room({-1, 0, -1}, {1, 2, 1}, {albedo, albedo, albedo}, {0.5f, 0.5f, 0.5f});
  room.build();
  proto::SolverSettings s = settings_for(method);
  s.bounces = method == proto::Method::kGather ? 64 : 12;
  const double emittance = math::kPi * 0.5;
  const double expected = method == proto::Method::kGather
                              ? emittance / (1 - albedo)
                              : emittance * (1 - std::pow(albedo, 13)) / (1 - albedo);
  const SeedStudy study(room, s, kSeeds, all_texels(room));
  // The tolerance of the solver bounds what its tail may have missed.
  const double cut = method == proto::Method::kGather ? s.tolerance * expected : 0;
  EXPECT_NEAR(study.area_mean, expected,
              kSigmas * study.area_standard_error + kRounding * expected + cut);
  for (std::size_t i = 0; i < study.mean.size(); ++i)
    EXPECT_NEAR(study.mean[i], expected, kSigmas * study.standard_error[i] + 1e-3 * expected + cut)
        << "texel " << i;
}

// Emitters as senders: the light is that of shadow rays where a lamp has the same radiance all
// over, so that the texels tell it as it is. Methods over pairs of texels read emitters at the
// middles of texels, and converge: senders_test.cpp.
class Transported : public testing::TestWithParam<std::tuple<proto::Method, std::uint32_t>> {};
INSTANTIATE_TEST_SUITE_P(Methods, Transported,
                         testing::Combine(testing::Values(proto::Method::kGather,
                                                          proto::Method::kPath,
                                                          proto::Method::kRadiosityMap),
                                          testing::Values(0u, 3u)));

TEST_P(Transported, EmittersBringTheLightOfShadowRays) {
  constexpr std::uint32_t kFaces = 11;  // but the lamp
  QuadScene box(48);
  box.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.6f, 0.5f});
  box.add_block({-0.6f, 0, -0.5f}, {-0.05f, 0.9f, 0.05f}, {0.5f, 0.5f, 0.5f});
  box.add({{-0.6f, 1.9f, -0.6f}, {1.2f, 0, 0}, {0, 0, 1.2f}, {0.3f, 0.3f, 0.3f}, {5, 4, 3}});
  box.build();
  proto::SolverSettings s = settings_for(std::get<0>(GetParam()));
  s.bounces = std::get<1>(GetParam());
  s.samples = 128;
  s.tolerance = 0;
  s.coarse_indirect = false;
  s.series = proto::Series::kUnbiased;
  const std::vector<Solution> sampled = bakes_of_seeds(box, s, kSeeds);
  s.emitters = proto::Emitters::kTransport;
  const std::vector<Solution> transported = bakes_of_seeds(box, s, kSeeds);
  const SeedStudy expected(box, sampled, all_texels(box));
  const SeedStudy study(box, transported, all_texels(box));
  for (std::uint32_t q = 0; q < kFaces; ++q) {
    const SeedStudy one(box, sampled, box.texels_of(q)), other(box, transported, box.texels_of(q));
    const double error = std::hypot(one.area_standard_error, other.area_standard_error);
    EXPECT_NEAR(other.area_mean, one.area_mean, kSigmas * error + kRounding * expected.area_mean)
        << "face " << q;
    EXPECT_LT(error, 0.02 * expected.area_mean) << "the test can fail";
  }
  // A direction brings at most the brightest radiosity B, so that the variance of a texel is no
  // more than B E / N: seeds that meet a lamp nowhere tell nothing of it themselves.
  const double brightest = double(math::kPi) * 4 + 0.6 * std::ranges::max(expected.mean);
  double square = 0, most = 0;
  for (std::size_t i = 0; i < study.mean.size(); ++i) {
    const double off = study.mean[i] - expected.mean[i];
    square += off * off;
    most += brightest * expected.mean[i] / (double(*s.samples) * kSeeds) +
            expected.standard_error[i] * expected.standard_error[i];
  }
  EXPECT_LT(square, 1.2 * most);
  for (const math::Rgb& e : transported.front().light->direct) ASSERT_TRUE(is_black(e));
}

double face_mean(const QuadScene& scene, std::uint32_t quad, proto::Method method,
                 double* standard_error) {
  const SeedStudy study(scene, settings_for(method), kSeeds, scene.texels_of(quad));
  *standard_error = study.area_standard_error;
  return study.area_mean;
}

// Two parallel unit squares at distance 1: F = 0.199824896 [Howell, configuration C-11].
TEST_P(EveryMethod, ParallelSquares) {
  QuadScene plates(32);
  const auto floor = plates.add({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}});
  plates.add({{0, 1, 0}, {1, 0, 0}, {0, 0, 1}, {}, {1, 1, 1}});
  plates.build();
  double error = 0;
  const double e = face_mean(plates, floor, GetParam(), &error);
  EXPECT_NEAR(e / math::kPi, 0.199824896, kSigmas * error / math::kPi + kRounding * 0.2);
}

// Two unit squares at a right angle with a common edge: F = 0.200043776 [Howell, C-14].
TEST_P(EveryMethod, PerpendicularSquares) {
  QuadScene plates(32);
  const auto floor = plates.add({{0, 0, 0}, {0, 0, 1}, {1, 0, 0}});
  plates.add({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {}, {1, 1, 1}});
  plates.build();
  double error = 0;
  const double e = face_mean(plates, floor, GetParam(), &error);
  EXPECT_NEAR(e / math::kPi, 0.200043776, kSigmas * error / math::kPi + kRounding * 0.2);
}

// A rectangle light, texel by texel, against Lambert's polygon formula at the texel's own points.
TEST_P(EveryMethod, RectangleLightIsLambertsFormula) {
  QuadScene scene(32);
  const auto floor = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  scene.build();
  // Beside and close to the floor, tilted: near field, horizon, and a side that is turned away.
  const scene::RectLight light{{0.2f, 0.1f, -0.3f}, {0.6f, 0.3f, 0}, {0, 0, 0.7f}, {2, 2, 2}};
  scene.scene().rect_lights.push_back(light);
  const auto texels = scene.texels_of(floor);
  const SeedStudy study(scene, settings_for(GetParam()), kSeeds, texels);
  const math::Vec3 normal = normalize(cross(light.edge_u, light.edge_v));
  double sum = 0, expected_sum = 0;
  for (std::size_t i = 0; i < texels.size(); ++i) {
    double expected = 0;
    for (const atlas::SamplePoint& p : scene.texels().points_of(texels[i])) {
      const math::Vec3 at = position_at(scene.scene(), p.triangle, p.bary());
      if (dot(normal, at - light.corner) <= 0) continue;
      const math::Vec3 far = light.corner + light.edge_u + light.edge_v;
      expected += 2 *
                  (sampling::polygon_irradiance(
                       at, {0, 1, 0},
                       std::array<math::Vec3, 3>{light.corner, light.corner + light.edge_u, far}) +
                   sampling::polygon_irradiance(
                       at, {0, 1, 0},
                       std::array<math::Vec3, 3>{light.corner, far, light.corner + light.edge_v})) /
                  atlas::TextureGroup::kPointsPerTexel;
    }
    EXPECT_NEAR(study.mean[i], expected, kSigmas * study.standard_error[i] + kRounding * expected)
        << "texel " << i;
    sum += study.mean[i];
    expected_sum += expected;
  }
  ASSERT_GT(expected_sum, 0);
  EXPECT_NEAR(sum / expected_sum, 1, 5e-3);
}

// A double-sided lamp of the scene itself, which rays can hit, over a floor: from half the scene's
// size down to a ten-thousandth of it, where the lamp must not shadow its own light.
TEST_P(EveryMethod, LampCloseToASurfaceIsLambertsFormula) {
  for (const float height : {1.f, 0.05f, 0.0002f}) {
    QuadScene scene(64);
    const auto floor = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
    const Quad lamp{{-0.4f, height, -0.3f}, {0.9f, 0, 0}, {0, 0, 0.7f}, {}, {2, 2, 2}, true};
    scene.add(lamp);
    scene.build();
    const auto texels = scene.texels_of(floor);
    const SeedStudy study(scene, settings_for(GetParam()), kSeeds, texels);
    const math::Vec3 a = lamp.corner, b = a + lamp.edge_u, c = b + lamp.edge_v, d = a + lamp.edge_v;
    double expected = 0, area = 0;
    for (const std::uint32_t t : texels) {
      area += scene.texels().area_m2[t];
      for (const atlas::SamplePoint& p : scene.texels().points_of(t)) {
        const math::Vec3 at = position_at(scene.scene(), p.triangle, p.bary());
        expected +=
            2 * scene.texels().area_m2[t] / atlas::TextureGroup::kPointsPerTexel *
            (sampling::polygon_irradiance(at, {0, 1, 0}, std::array<math::Vec3, 3>{a, b, c}) +
             sampling::polygon_irradiance(at, {0, 1, 0}, std::array<math::Vec3, 3>{a, c, d}));
      }
    }
    expected /= area;
    EXPECT_NEAR(study.area_mean, expected, kSigmas * study.area_standard_error + 1e-3 * expected)
        << "lamp at " << height;
  }
}

// Nothing is random in the unoccluded light of a punctual light at a given point.
TEST_P(EveryMethod, PunctualLightsAreInverseSquareCosineAndCone) {
  QuadScene scene(16);
  const auto floor = scene.add({{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}});
  scene.build();
  scene::PunctualLight point;
  point.intensity = {10, 10, 10};
  point.position = {0.3f, 0.8f, 0};
  point.range = 3;
  scene::PunctualLight spot = point;
  spot.type = scene::PunctualType::kSpot;
  spot.range = 0;
  spot.direction = {0, -1, 0};
  spot.cos_inner = std::cos(0.2f);
  spot.cos_outer = std::cos(0.7f);
  scene::PunctualLight sun;
  sun.type = scene::PunctualType::kDirectional;
  sun.intensity = {5, 5, 5};
  sun.direction = normalize(math::Vec3{1, -2, 0.5f});
  for (const scene::PunctualLight& light : {point, spot, sun}) {
    scene.scene().lights = {light};
    const Solution solution = scene.solve(settings_for(GetParam()));
    for (const std::uint32_t t : scene.texels_of(floor)) {
      double expected = 0;
      for (const atlas::SamplePoint& p : scene.texels().points_of(t)) {
        const math::Vec3 at = position_at(scene.scene(), p.triangle, p.bary());
        const math::Vec3 d = light.position - at;
        const double r2 = dot(d, d), cosine = d.y / std::sqrt(r2);
        double e = 0;
        if (light.type == scene::PunctualType::kDirectional) {
          e = 5 * -light.direction.y;
        } else if (light.type == scene::PunctualType::kPoint) {
          e = 10 * cosine / r2 * (1 - r2 * r2 / 81);  // range window, range 3 m
        } else {
          const double t_cone =
              std::clamp((cosine - light.cos_outer) / (light.cos_inner - light.cos_outer), 0., 1.);
          e = 10 * cosine / r2 * t_cone * t_cone;
        }
        expected += e / atlas::TextureGroup::kPointsPerTexel;
      }
      EXPECT_NEAR(solution.light->irradiance(t).g, expected, 1e-4 * expected + 1e-6);
    }
  }
}

// An open surface sees the whole hemisphere of a uniform sky: E = πL, however it is tilted.
TEST_P(EveryMethod, OpenPlaneUnderSky) {
  for (const math::Vec3 edge : {math::Vec3{1, 0, 0}, math::Vec3{0.6f, 0.8f, 0}}) {
    QuadScene scene(16);
    const auto quad = scene.add({{0, 0, 0}, {0, 0, 1}, edge});
    scene.build();
    scene.scene().sky = {2, 2, 2};
    const Solution solution = scene.solve(settings_for(GetParam()));
    for (const std::uint32_t t : scene.texels_of(quad))
      EXPECT_NEAR(solution.light->irradiance(t).g, 2 * math::kPi, 1e-4);
  }
}

// Over black ground without end, a surface tilted by β sees the share (1 + cos β)/2 of the sky.
// The ground here ends at 500 m: the rim hides less than (1/500) of the horizon's cosine.
TEST_P(EveryMethod, TiltedPlaneOverBlackGround) {
  QuadScene scene(32);
  scene.add({{-500, 0, -500}, {0, 0, 1000}, {1000, 0, 0}});
  const auto panel = scene.add({{0, 1, 0}, {0, 0, 0.1f}, {0.06f, 0.08f, 0}});
  scene.build();
  scene.scene().sky = {1, 1, 1};
  const SeedStudy study(scene, settings_for(GetParam()), kSeeds, scene.texels_of(panel));
  const double expected = math::kPi * (1 + 0.6) / 2;
  EXPECT_NEAR(study.area_mean, expected, kSigmas * study.area_standard_error + 2e-3 * expected);
}

// No light finds its way into a closed room, along no edge and at no corner; nor at texels that a
// wall only touches, all of whose points lie on its edge but for rounding.
void expect_dark_in_sealed_room(proto::Method method, float overhang) {
  QuadScene room(64, overhang);
  room.add_room({-1, 0, -1}, {1, 2, 1}, {0.8f, 0.8f, 0.8f});
  room.build();
  room.scene().sky = {1000, 1000, 1000};
  scene::PunctualLight lamp;
  lamp.position = {0, 2.5f, 0};
  lamp.intensity = {1e6f, 1e6f, 1e6f};
  room.scene().lights = {lamp};
  proto::SolverSettings s = settings_for(method);
  s.samples = 256;
  s.bounces = 4;
  const Solution solution = room.solve(s);
  for (std::uint32_t t = 0; t < room.texels().size(); ++t)
    ASSERT_TRUE(is_black(solution.light->irradiance(t))) << "texel " << t;
}
TEST_P(EveryMethod, SealedRoomIsExactlyDark) {
  expect_dark_in_sealed_room(GetParam(), 0);
}
TEST_P(EveryMethod, SealedRoomIsExactlyDarkAtTexelsThatAWallOnlyTouches) {
  expect_dark_in_sealed_room(GetParam(), 1e-4f);
}

// Light that a lamp gives is absorbed in the end: Σ A (1-ρ) E = Φ in each channel of a closed box.
TEST(GatherEnergy, ClosedColoredBoxAbsorbsWhatItsLampEmits) {
  QuadScene room(128);
  room.add_room({-1, 0, -1}, {1, 2, 1}, {0.7f, 0.4f, 0.2f});
  room.add_block({-0.5f, 0.2f, -0.3f}, {0.1f, 0.9f, 0.2f}, {0.2f, 0.6f, 0.5f}, true);
  room.add({{-0.3f, 1.9f, -0.3f}, {0.6f, 0, 0}, {0, 0, 0.6f}, {}, {4, 3, 2}});
  // The lamp's back is closed by a black plate, so that no light is lost behind it.
  room.add({{-0.3f, 1.91f, -0.3f}, {0, 0, 0.6f}, {0.6f, 0, 0}});
  room.build();
  proto::SolverSettings s = settings_for(proto::Method::kGather);
  s.samples = 256;
  s.bounces = 64;
  const Solution solution = room.solve(s);
  double absorbed[3] = {};
  const atlas::TextureGroup& t = room.texels();
  for (std::uint32_t i = 0; i < t.size(); ++i) {
    const math::Rgb e = solution.light->irradiance(i), a = t.albedo[i];
    const double area = t.area_m2[i];
    absorbed[0] += area * (1 - a.r) * e.r;
    absorbed[1] += area * (1 - a.g) * e.g;
    absorbed[2] += area * (1 - a.b) * e.b;
  }
  const double emitted[3] = {math::kPi * 4 * 0.36, math::kPi * 3 * 0.36,
                             math::kPi * 2 * 0.36};  // π L A
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(absorbed[c] / emitted[c], 1, 5e-3) << "channel " << c;
}

// A flat lamp sees nothing of itself, also where coordinates are large against its distance to its
// own plane: their rounding must not lift its points above it.
TEST_P(EveryMethod, FlatLampDoesNotLightItself) {
  for (const math::Vec3 corner : {math::Vec3{0, 0, 0}, math::Vec3{213.1f, 547.9f, 227.3f}}) {
    QuadScene scene(32);
    const auto lamp =
        scene.add({corner, {3.1f, 0.017f, 0.3f}, {0.2f, -0.013f, 2.7f}, {}, {9, 9, 9}});
    scene.build();
    const Solution solution = scene.solve(settings_for(GetParam()));
    for (const std::uint32_t t : scene.texels_of(lamp))
      ASSERT_TRUE(is_black(solution.light->irradiance(t))) << "texel " << t;
  }
}

// A double-sided sheet between two lamps: each side holds its own light.
TEST_P(EveryMethod, DoubleSidedSheetKeepsItsSidesApart) {
  QuadScene scene(32);
  Quad sheet{{-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, {0.5f, 0.5f, 0.5f}};
  sheet.double_sided = true;
  const auto quad = scene.add(sheet);
  scene.build();
  scene::PunctualLight above, below;
  above.type = below.type = scene::PunctualType::kDirectional;
  above.direction = {0, -1, 0}, above.intensity = {3, 3, 3};
  below.direction = {0, 1, 0}, below.intensity = {7, 7, 7};
  scene.scene().lights = {above, below};
  const Solution solution = scene.solve(settings_for(GetParam()));
  for (const std::uint32_t t : scene.texels_of(quad)) {
    EXPECT_NEAR(solution.light->irradiance(t).g, 3, 1e-5);
    ASSERT_GE(scene.texels().back[t], 0);
    const auto back = static_cast<std::uint32_t>(scene.texels().back[t]);
    EXPECT_NEAR(solution.light->irradiance(back).g, 7, 1e-5);
  }
}

}  // namespace
}  // namespace kiln::solver
