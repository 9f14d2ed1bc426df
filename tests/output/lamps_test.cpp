#include "baker/output/lamps.h"

#include <gtest/gtest.h>

namespace kiln::output {
namespace {

/// Texels of 10 cm, each with its light.
struct Surfaces {
  atlas::TextureGroup texels;
  std::vector<float> irradiance, emission;

  void add(math::Vec3 position, math::Vec3 normal, float lx, float cd_per_m2 = 0) {
    texels.position.push_back(position);
    texels.shading_normal.push_back(normal);
    texels.area_m2.push_back(0.01f);
    texels.coverage.push_back(1);
    irradiance.push_back(lx);
    emission.push_back(cd_per_m2);
    ++texels.front_count;
  }
  std::vector<bool> hidden() const {
    const auto gray = [](const std::vector<float>& values) -> TexelValue {
      return [&values](std::uint32_t t) -> math::Rgb { return {values[t], values[t], values[t]}; };
    };
    return hidden_by_lamps(texels, gray(irradiance), gray(emission), {}).value();
  }
};

TEST(HiddenByLamps, LampsAndWhatTheyLieAgainst) {
  const math::Vec3 down{0, -1, 0}, up{0, 1, 0};
  Surfaces s;
  for (int i = 0; i < 100; ++i) s.add({float(i), 0, 5}, up, 10);  // a floor far away
  s.add({0, 2.95f, 0}, down, 20, 100);                            // 100: the lamp
  s.add({0.02f, 3, -0.03f}, down, 300);                           // 101: the ceiling behind it
  s.add({0.02f, 3, -0.03f}, down, 20);       // 102: the same, but the lamp does not light it
  s.add({0.1f, 3, 0}, down, 300);            // 103: beside the lamp
  s.add({0, 2.95f, 0.05f}, down, 300);       // 104: in its plane
  s.add({0.05f, 2.95f, 0}, {1, 0, 0}, 300);  // 105: at a right angle
  s.add({0, 2.8f, 0}, up, 300);              // 106: in front of it, but to be seen
  s.add({0, 3, 0}, up, 300);                 // 107: on the roof
  s.add({0, 2.95f, 0.5f}, down, 400, 100);   // 108: shines, but is lit by more than that
  const std::vector<bool> hidden = s.hidden();
  for (std::uint32_t t = 0; t < s.texels.front_count; ++t)
    EXPECT_EQ(hidden[t], t == 100 || t == 101) << t;
}

TEST(HiddenByLamps, WhereAllGlowsNothingIsBehindALamp) {
  Surfaces s;
  for (int i = 0; i < 20; ++i) s.add({float(i), 0, 0}, {0, 1, 0}, 10, 100);
  s.add({0, -0.05f, 0}, {0, 1, 0}, 300);
  const std::vector<bool> hidden = s.hidden();
  for (std::uint32_t t = 0; t < 21; ++t) EXPECT_EQ(hidden[t], t < 20) << t;
}

TEST(HiddenByLamps, StopsWhenTold) {
  Surfaces s;
  for (int i = 0; i < 5000; ++i) s.add({float(i), 0, 0}, {0, 1, 0}, 10);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(hidden_by_lamps(
      s.texels, [](std::uint32_t) { return math::Rgb{}; },
      [](std::uint32_t) { return math::Rgb{}; }, stop.get_token()));
}

}  // namespace
}  // namespace kiln::output
