// The codec of attributes and the filters of EXT_meshopt_compression, against data that is encoded
// here as the extension's text has it: no library is asked what it means.
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "baker/gltf/meshopt.h"
#include "tests/import/bad_input.h"
#include "tests/support/packed_gltf.h"

namespace kiln::import {
namespace {

using Bytes = std::vector<std::uint8_t>;

std::uint8_t zigzag(std::uint8_t delta) {
  return static_cast<std::uint8_t>(delta << 1 ^ (delta & 0x80 ? 0xff : 0));
}

/// Sixteen deltas in so many bits each; those that need more follow as bytes.
Bytes packed_deltas(const std::array<std::uint8_t, 16>& deltas, unsigned bits) {
  if (bits == 0 || bits == 8) return bits == 0 ? Bytes() : Bytes(deltas.begin(), deltas.end());
  const unsigned escape = (1u << bits) - 1, per_byte = 8 / bits;
  Bytes out(16 / per_byte), more;
  for (unsigned i = 0; i < 16; ++i) {
    const unsigned code = std::min<unsigned>(deltas[i], escape);
    if (code == escape) more.push_back(deltas[i]);
    out[i / per_byte] =
        static_cast<std::uint8_t>(out[i / per_byte] | code << (8 - bits * (i % per_byte + 1)));
  }
  out.insert(out.end(), more.begin(), more.end());
  return out;
}

/// Mode 0, "attributes": blocks of up to 256 elements, byte by byte of the element, in groups of
/// sixteen, each in the fewest bytes; then the first element.
std::string packed_attributes(const Bytes& plain, std::size_t stride) {
  const std::size_t count = plain.size() / stride,
                    block = std::min<std::size_t>(8192 / stride / 16 * 16, 256);
  Bytes out{0xa0};
  Bytes last(plain.begin(), plain.begin() + std::ptrdiff_t(stride));
  for (std::size_t begin = 0; begin < count; begin += block) {
    const std::size_t n = std::min(block, count - begin), groups = (n + 15) / 16;
    for (std::size_t k = 0; k < stride; ++k) {
      Bytes head((groups + 3) / 4), body;
      for (std::size_t g = 0; g < groups; ++g) {
        std::array<std::uint8_t, 16> deltas{};
        for (std::size_t i = 0; i < 16 && 16 * g + i < n; ++i) {
          const std::uint8_t value = plain[(begin + 16 * g + i) * stride + k];
          deltas[i] = zigzag(static_cast<std::uint8_t>(value - last[k]));
          last[k] = value;
        }
        unsigned code = 3;
        Bytes best = packed_deltas(deltas, 8);
        for (const unsigned c : {2u, 1u})
          if (auto shorter = packed_deltas(deltas, 2 * c); shorter.size() < best.size())
            best = std::move(shorter), code = c;
        if (deltas == std::array<std::uint8_t, 16>{}) best = {}, code = 0;
        head[g / 4] = static_cast<std::uint8_t>(head[g / 4] | code << (g % 4 * 2));
        body.insert(body.end(), best.begin(), best.end());
      }
      out.insert(out.end(), head.begin(), head.end());
      out.insert(out.end(), body.begin(), body.end());
    }
  }
  out.resize(out.size() + (stride < 32 ? 32 - stride : 0));
  out.insert(out.end(), plain.begin(), plain.begin() + std::ptrdiff_t(stride));
  return {out.begin(), out.end()};
}

template <class T>
Bytes bytes_of(const std::vector<T>& values) {
  Bytes out(values.size() * sizeof(T));
  std::memcpy(out.data(), values.data(), out.size());
  return out;
}

template <class T>
std::vector<T> decoded(const std::vector<T>& stored, std::size_t stride,
                       const std::string& filter) {
  const Bytes plain = bytes_of(stored);
  gltf::MeshoptView view{plain.size() / stride, stride, "ATTRIBUTES", filter};
  const std::string packed = packed_attributes(plain, stride);
  EXPECT_EQ(gltf::wrong_with(view, packed.size(), plain.size(), 0), "");
  std::string out;
  EXPECT_EQ(gltf::decode_meshopt(view, packed, out), "");
  std::vector<T> values(out.size() / sizeof(T));
  std::memcpy(values.data(), out.data(), values.size() * sizeof(T));
  return values;
}

struct Random {
  std::uint32_t state = 1;
  std::uint32_t operator()() { return (state = state * 1664525u + 1013904223u) >> 8; }
  double between(double low, double high) { return low + (high - low) * (*this)() / 0x1p24; }
};

TEST(MeshoptFilters, NoneGivesBackEveryByte) {
  Random random;
  for (const std::size_t stride : {4, 8, 12, 64, 256})
    for (const std::size_t count : {1, 15, 16, 17, 255, 256, 257, 1000}) {
      Bytes plain(count * stride);
      for (std::size_t i = stride; i < plain.size(); ++i) {
        // Columns that stay, that change a little, a little more, and wildly.
        const std::uint32_t step = std::array{0u, random() % 3, random() % 12, random()}[i % 4];
        plain[i] = static_cast<std::uint8_t>(plain[i - stride] + step);
      }
      EXPECT_EQ(decoded(plain, stride, "NONE"), plain) << stride << " x " << count;
    }
}

/// A vector of length 1, in the octahedron's square: x, y and what stands for one, in `bits` bits.
template <class T>
std::array<T, 4> octahedral(const std::array<double, 3>& v, unsigned bits, T w) {
  const double one = double((1 << (bits - 1)) - 1);
  const double sum = std::abs(v[0]) + std::abs(v[1]) + std::abs(v[2]);
  double x = v[0] / sum, y = v[1] / sum;
  if (v[2] < 0) {
    const double folded = (1 - std::abs(y)) * (x < 0 ? -1 : 1);
    y = (1 - std::abs(x)) * (y < 0 ? -1 : 1);
    x = folded;
  }
  return {T(std::lround(x * one)), T(std::lround(y * one)), T(one), w};
}

template <class T>
void expect_octahedral(unsigned bits) {
  constexpr double kMax = std::numeric_limits<T>::max();
  Random random;
  std::vector<std::array<double, 3>> wanted{{0, 0, 1}, {0, 0, -1}, {1, 0, 0}, {0, -1, 0}};
  while (wanted.size() < 500) {
    const double z = random.between(-1, 1), a = random.between(0, 2 * std::numbers::pi),
                 r = std::sqrt(1 - z * z);
    wanted.push_back({r * std::cos(a), r * std::sin(a), z});
  }
  std::vector<T> stored;
  for (std::size_t i = 0; i < wanted.size(); ++i)
    for (const T part : octahedral<T>(wanted[i], bits, T(i % 100))) stored.push_back(part);
  const std::vector<T> out = decoded(stored, 4 * sizeof(T), "OCTAHEDRAL");
  ASSERT_EQ(out.size(), stored.size());
  // Half a step of x and of y moves z by a whole one, before lengths grow by up to sqrt(3).
  const double step = 1 / double((1 << (bits - 1)) - 1),
               bound = std::sqrt(3.0) * step * std::sqrt(1.5) + 1 / kMax;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(out[4 * i + k] / kMax, wanted[i][k], bound) << bits << " bits, " << i;
    EXPECT_EQ(out[4 * i + 3], T(i % 100)) << "the fourth number is nobody's";
  }
}

TEST(MeshoptFilters, OctahedralVectors) {
  for (const unsigned bits : {4u, 6u, 8u}) expect_octahedral<std::int8_t>(bits);
  for (const unsigned bits : {8u, 12u, 16u}) expect_octahedral<std::int16_t>(bits);
}

TEST(MeshoptFilters, Quaternions) {
  Random random;
  for (const int bits : {6, 8, 12, 16}) {
    const double one = double((1 << (bits - 1)) - 1);
    std::vector<std::array<double, 4>> wanted{{1, 0, 0, 0}, {0, 0, 0, -1}, {0.5, 0.5, 0.5, 0.5}};
    std::vector<std::int16_t> stored;
    while (wanted.size() < 500) {
      std::array<double, 4> q{};
      double squares = 0;
      for (double& part : q) part = random.between(-1, 1), squares += part * part;
      if (squares < 0.01 || squares > 1) continue;
      for (double& part : q) part /= std::sqrt(squares);
      wanted.push_back(q);
    }
    for (auto& q : wanted) {
      const auto less = [](double a, double b) { return std::abs(a) < std::abs(b); };
      const auto m = std::size_t(std::max_element(q.begin(), q.end(), less) - q.begin());
      if (q[m] < 0)
        for (double& part : q) part = -part;  // the same rotation
      for (std::size_t k = 1; k < 4; ++k)
        stored.push_back(std::int16_t(std::lround(q[(m + k) % 4] * std::numbers::sqrt2 * one)));
      stored.push_back(std::int16_t((int(one) & ~3) | int(m)));
    }
    const auto out = decoded(stored, 8, "QUATERNION");
    ASSERT_EQ(out.size(), stored.size());
    // Half a step of each of three numbers; the largest, which follows from them, moves no more
    // than they do together, and by terms of second order.
    const double half = 0.5 / one / std::numbers::sqrt2,
                 bound = 3 * half + 3 * half * half + 1 / 32767.0;
    for (std::size_t i = 0; i < wanted.size(); ++i)
      for (std::size_t k = 0; k < 4; ++k)
        EXPECT_NEAR(out[4 * i + k] / 32767.0, wanted[i][k], bound) << bits << " bits, " << i;
  }
}

TEST(MeshoptFilters, ExponentialNumbersAreExact) {
  Random random;
  std::vector<std::uint32_t> stored;
  std::vector<float> wanted;
  const auto add = [&](std::int32_t mantissa, std::int32_t exponent) {
    stored.push_back((std::uint32_t(mantissa) & 0xffffffu) | std::uint32_t(exponent) << 24);
    wanted.push_back(std::ldexp(float(mantissa), exponent));
  };
  for (const std::int32_t mantissa : {0, 1, -1, 0x7fffff, -0x800000})
    for (const std::int32_t exponent : {-100, -24, -1, 0, 1, 100}) add(mantissa, exponent);
  while (stored.size() < 900)
    add(std::int32_t(random() & 0xffffffu) - 0x800000, std::int32_t(random() % 200) - 100);
  for (const std::size_t stride : {4, 12}) {
    const auto out = decoded(stored, stride, "EXPONENTIAL");
    for (std::size_t i = 0; i < wanted.size(); ++i)
      EXPECT_EQ(std::bit_cast<float>(out[i]), wanted[i]) << i;
  }
}

/// A triangle with a view of its own that holds rotations, which nothing reads.
test::GltfBuilder with_rotations(const json& changes, char first_byte = '\xa0') {
  GltfBuilder b = test::triangle_builder();
  const std::vector<std::int16_t> stored{0, 0, 0, 0x7fff, 0, 0, 0, 0x7ffe};
  b.accessor(stored, 4, true);
  b = test::packed_by_meshopt(b, {{"ATTRIBUTES", "NONE", 12}, {"ATTRIBUTES", "QUATERNION", 8}});
  json& view = b.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"];
  b.binary[view["byteOffset"].get<std::size_t>()] = first_byte;
  view.update(changes);
  return b;
}

TEST(MeshoptFilters, WhatIsNotSupportedIsAnErrorWithItsPlace) {
  EXPECT_EQ(import::imported(with_rotations(json::object())).triangles.size(), 1u);
  const std::string at = "/bufferViews/1/extensions/EXT_meshopt_compression";
  const auto refused = [&](const test::GltfBuilder& b, const std::string& place) {
    import::expect_refused(b.glb(), "invalid_scene", place);
    return import::import_bytes(b.glb()).error().message;
  };
  // KHR_meshopt_compression has this filter, and a version 1 of the codec.
  EXPECT_NE(refused(with_rotations({{"filter", "COLOR"}}), at + "/filter").find("QUATERNION"),
            std::string::npos);
  EXPECT_NE(refused(with_rotations(json::object(), '\xa1'), at).find("version 1"),
            std::string::npos);
  EXPECT_NE(refused(with_rotations(json::object(), '\xe1'), at).find("damaged"), std::string::npos);
  for (const auto& [filter, stride, count] :
       {std::tuple("QUATERNION", 4, 4), {"QUATERNION", 16, 1}, {"OCTAHEDRAL", 16, 1}})
    EXPECT_NE(
        refused(with_rotations({{"filter", filter}, {"byteStride", stride}, {"count", count}}), at)
            .find("filter has a byteStride"),
        std::string::npos)
        << filter << stride;
  test::GltfBuilder later = with_rotations(json::object());
  later.json["extensionsUsed"] = later.json["extensionsRequired"] = {"KHR_meshopt_compression"};
  import::expect_refused(later.glb(), "unsupported_extension", "/extensionsRequired/0");
}

}  // namespace
}  // namespace kiln::import
