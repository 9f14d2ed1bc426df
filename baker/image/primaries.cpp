#include "baker/image/primaries.h"

#include <cmath>
#include <initializer_list>

namespace kiln::image {
namespace {

using Triple = std::array<double, 3>;
using Matrix = std::array<Triple, 3>;  // rows

Triple operator*(const Matrix& m, const Triple& v) {
  Triple out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) out[i] += m[i][k] * v[k];
  return out;
}

Matrix operator*(const Matrix& a, const Matrix& b) {
  Matrix out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) out[i][j] += a[i][k] * b[k][j];
  return out;
}

/// Multiplies each column by its factor.
Matrix scaled(Matrix m, const Triple& columns) {
  for (Triple& row : m)
    for (std::size_t j = 0; j < 3; ++j) row[j] *= columns[j];
  return m;
}

double cofactor(const Matrix& m, std::size_t i, std::size_t j) {
  const std::size_t a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
  return m[a][c] * m[b][d] - m[a][d] * m[b][c];
}

double determinant(const Matrix& m) {
  return m[0][0] * cofactor(m, 0, 0) + m[0][1] * cofactor(m, 0, 1) + m[0][2] * cofactor(m, 0, 2);
}

Matrix inverse(const Matrix& m) {
  const double scale = 1 / determinant(m);
  Matrix out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) out[i][j] = cofactor(m, j, i) * scale;
  return out;
}

/// Returns the XYZ of the color, X + Y + Z being 1.
Triple xyz(const Primaries::Point& p) {
  return {double(p[0]), double(p[1]), 1 - double(p[0]) - double(p[1])};
}

/// Returns the XYZ of white, Y being 1.
Triple white_of(const Primaries& p) {
  Triple white = xyz(p.white);
  for (double& v : white) v /= double(p.white[1]);
  return white;
}

/// Returns nothing where a primary would have to be black or negative, or numbers are out of all
/// reason.
std::optional<Matrix> to_xyz(const Primaries& p) {
  constexpr double kFarthest = 10, kLeast = 1e-3;
  for (const auto& point : {p.red, p.green, p.blue, p.white})
    for (const float v : point)
      if (!(std::abs(double(v)) <= kFarthest)) return std::nullopt;
  const Triple r = xyz(p.red), g = xyz(p.green), b = xyz(p.blue);
  const Matrix columns{{{r[0], g[0], b[0]}, {r[1], g[1], b[1]}, {r[2], g[2], b[2]}}};
  if (!(double(p.white[1]) >= kLeast) || !(std::abs(determinant(columns)) >= kLeast))
    return std::nullopt;
  const Triple shares = inverse(columns) * white_of(p);
  for (const double share : shares)
    if (!(share >= kLeast)) return std::nullopt;
  return scaled(columns, shares);
}

/// Turns XYZ into what stands for the three kinds of cones.
constexpr Matrix kBradford{
    {{0.8951, 0.2664, -0.1614}, {-0.7502, 1.7135, 0.0367}, {0.0389, -0.0685, 1.0296}}};

}  // namespace

bool Primaries::is_rec709() const {
  constexpr float kRounding = 6e-4f;
  const Primaries rec709;
  const auto is_near = [&](const Point& a, const Point& b) {
    return std::abs(a[0] - b[0]) <= kRounding && std::abs(a[1] - b[1]) <= kRounding;
  };
  return is_near(red, rec709.red) && is_near(green, rec709.green) && is_near(blue, rec709.blue) &&
         is_near(white, rec709.white);
}

std::optional<ColorConversion> ColorConversion::from(const Primaries& primaries) {
  const auto source = to_xyz(primaries);
  if (!source) return std::nullopt;
  const Triple from = kBradford * white_of(primaries), to = kBradford * white_of({});
  Triple gain{};
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(from[i] > 0)) return std::nullopt;
    gain[i] = to[i] / from[i];
  }
  const Matrix adapt = scaled(inverse(kBradford), gain) * kBradford;
  const Matrix whole = inverse(*to_xyz({})) * (adapt * *source);
  ColorConversion out;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) out.rows_[i][j] = float(whole[i][j]);
  return out;
}

}  // namespace kiln::image
