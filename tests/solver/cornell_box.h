#pragma once

#include <memory>

#include "tests/support/quad_scene.h"

namespace kiln::solver {

/// A Cornell box of 2 m with two blocks.
inline std::unique_ptr<QuadScene> cornell(std::uint32_t page_size) {
  auto box = std::make_unique<QuadScene>(page_size);
  const math::Rgb white{0.73f, 0.73f, 0.73f}, red{0.63f, 0.06f, 0.05f}, green{0.14f, 0.45f, 0.09f};
  const math::Vec3 x{2, 0, 0}, y{0, 2, 0}, z{0, 0, 2};
  box->add({{-1, 0, -1}, y, z, red});
  box->add({{1, 0, -1}, z, y, green});
  box->add({{-1, 0, -1}, z, x, white});
  box->add({{-1, 2, -1}, x, z, white});
  box->add({{-1, 0, -1}, x, y, white});
  box->add({{-1, 0, 1}, y, x, white});
  box->add_block({-0.6f, 0, -0.5f}, {-0.05f, 1.2f, 0.05f}, white);
  box->add_block({0.1f, 0, 0}, {0.65f, 0.6f, 0.55f}, white);
  box->add({{-0.25f, 1.99f, -0.25f}, {0.5f, 0, 0}, {0, 0, 0.5f}, {}, {12, 10, 7}});
  box->build();
  return box;
}

/// Standard deviation of one kind of light between seeds, relative to its mean.
inline double scatter(const QuadScene& scene, proto::SolverSettings s,
                      lightmap::Plane<math::Rgb> lightmap::Lightmap::*light, int pairs = 4) {
  double square = 0, mean = 0;
  for (int pair = 0; pair < pairs; ++pair) {
    s.seed = 21 + 2 * std::uint64_t(pair);
    const Solution a = scene.solve(s);
    ++s.seed;
    const Solution b = scene.solve(s);
    for (std::uint32_t t = 0; t < scene.texels().size(); ++t) {
      const double one = (std::as_const(*a.light).*light)[t].g;
      const double other = (std::as_const(*b.light).*light)[t].g;
      square += (one - other) * (one - other) / 2;
      mean += one;
    }
  }
  const double n = double(pairs) * scene.texels().size();
  return std::sqrt(square / n) / (mean / n);
}

}  // namespace kiln::solver
