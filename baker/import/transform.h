#pragma once

#include <array>

#include "baker/math/vec.h"

namespace kiln::import {

/// An affine map in double precision, so that deep hierarchies stay exact: p' = m * p + t.
struct Transform {
  std::array<std::array<double, 3>, 3> m{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< rows
  std::array<double, 3> t{};

  math::Vec3 point(math::Vec3 p) const {
    const auto row = [&](std::size_t i) {
      return static_cast<float>(m[i][0] * p.x + m[i][1] * p.y + m[i][2] * p.z + t[i]);
    };
    return {row(0), row(1), row(2)};
  }
  /// A direction, not normalized.
  math::Vec3 direction(math::Vec3 v) const {
    const auto row = [&](std::size_t i) {
      return static_cast<float>(m[i][0] * v.x + m[i][1] * v.y + m[i][2] * v.z);
    };
    return {row(0), row(1), row(2)};
  }
  double determinant() const {
    const auto c = cofactors();
    return m[0][0] * c[0][0] + m[0][1] * c[0][1] + m[0][2] * c[0][2];
  }
  /// The cofactor matrix: maps normals, up to length and, for mirrors, sign.
  std::array<std::array<double, 3>, 3> cofactors() const {
    std::array<std::array<double, 3>, 3> c{};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        const std::size_t i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        c[i][j] = m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1];
      }
    }
    return c;
  }
};

/// Returns the map that applies first `b`, then `a`.
inline Transform operator*(const Transform& a, const Transform& b) {
  Transform out;
  for (std::size_t i = 0; i < 3; ++i) {
    out.t[i] = a.t[i];
    for (std::size_t j = 0; j < 3; ++j) {
      out.m[i][j] = a.m[i][0] * b.m[0][j] + a.m[i][1] * b.m[1][j] + a.m[i][2] * b.m[2][j];
      out.t[i] += a.m[i][j] * b.t[j];
    }
  }
  return out;
}

}  // namespace kiln::import
