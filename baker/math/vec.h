#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>

namespace kiln::math {

inline constexpr float kPi = 3.14159265358979323846f;

/// A vector of N numbers. Scalars convert to its type, so that `2 * v` keeps the precision of `v`.
template <int N, class T>
struct Vec;

template <class T>
struct Vec<2, T> {
  T x = 0, y = 0;
  bool operator==(const Vec&) const = default;
};

template <class T>
struct Vec<3, T> {
  T x = 0, y = 0, z = 0;
  bool operator==(const Vec&) const = default;
  T operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  Vec& operator+=(Vec b) {
    x += b.x, y += b.y, z += b.z;
    return *this;
  }
};

using Vec2 = Vec<2, float>;
using Vec3 = Vec<3, float>;
using Vec2d = Vec<2, double>;
using Vec3d = Vec<3, double>;

template <class T>
Vec<2, T> operator+(Vec<2, T> a, Vec<2, T> b) {
  return {a.x + b.x, a.y + b.y};
}
template <class T>
Vec<3, T> operator+(Vec<3, T> a, Vec<3, T> b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
Vec<2, T> operator-(Vec<2, T> a, Vec<2, T> b) {
  return {a.x - b.x, a.y - b.y};
}
template <class T>
Vec<3, T> operator-(Vec<3, T> a, Vec<3, T> b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
Vec<3, T> operator-(Vec<3, T> a) {
  return {-a.x, -a.y, -a.z};
}
template <class T>
Vec<2, T> operator*(Vec<2, T> a, std::type_identity_t<T> s) {
  return {a.x * s, a.y * s};
}
template <class T>
Vec<3, T> operator*(Vec<3, T> a, std::type_identity_t<T> s) {
  return {a.x * s, a.y * s, a.z * s};
}
template <class T>
Vec<3, T> operator*(std::type_identity_t<T> s, Vec<3, T> a) {
  return a * s;
}
template <class T>
T dot(Vec<2, T> a, Vec<2, T> b) {
  return a.x * b.x + a.y * b.y;
}
template <class T>
T dot(Vec<3, T> a, Vec<3, T> b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
T cross(Vec<2, T> a, Vec<2, T> b) {
  return a.x * b.y - a.y * b.x;
}
template <class T>
Vec<3, T> cross(Vec<3, T> a, Vec<3, T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <int N, class T>
T length(Vec<N, T> a) {
  return std::sqrt(dot(a, a));
}
/// Returns the unit vector along `a`, or `fallback` when `a` has no direction.
inline Vec3 normalize(Vec3 a, Vec3 fallback = {0, 0, 1}) {
  const float l = length(a);
  return l > 0 && std::isfinite(l) ? a * (1 / l) : fallback;
}
inline float max_abs(Vec3 a) {
  return std::max({std::abs(a.x), std::abs(a.y), std::abs(a.z)});
}
inline bool is_finite(Vec3 a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}
inline Vec3d to_double(Vec3 a) {
  return {double(a.x), double(a.y), double(a.z)};
}

/// A linear Rec. 709 triple. The name of the variable says whether it is radiance, irradiance or
/// albedo.
struct Rgb {
  float r = 0, g = 0, b = 0;
  bool operator==(const Rgb&) const = default;
  Rgb& operator+=(Rgb o) {
    r += o.r, g += o.g, b += o.b;
    return *this;
  }
};
inline Rgb operator+(Rgb a, Rgb b) {
  return {a.r + b.r, a.g + b.g, a.b + b.b};
}
inline Rgb operator-(Rgb a, Rgb b) {
  return {a.r - b.r, a.g - b.g, a.b - b.b};
}
inline Rgb operator*(Rgb a, Rgb b) {
  return {a.r * b.r, a.g * b.g, a.b * b.b};
}
inline Rgb operator*(Rgb a, float s) {
  return {a.r * s, a.g * s, a.b * s};
}
inline Rgb operator*(float s, Rgb a) {
  return a * s;
}
inline float max_channel(Rgb a) {
  return std::max({a.r, a.g, a.b});
}
inline float mean(Rgb a) {
  return (a.r + a.g + a.b) / 3;
}
inline float luminance(Rgb a) {
  return 0.2126f * a.r + 0.7152f * a.g + 0.0722f * a.b;
}
inline bool is_black(Rgb a) {
  return a.r == 0 && a.g == 0 && a.b == 0;
}

}  // namespace kiln::math
