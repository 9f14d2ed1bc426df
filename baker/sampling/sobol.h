#pragma once

#include <array>
#include <cstdint>

#include "baker/math/vec.h"

/// Low-discrepancy points and hashes. Stateless: every number follows from its arguments, so any
/// thread can make any sample [Burley, "Practical Hash-based Owen Scrambling", JCGT 2020].
namespace kiln::sampling {

/// Mixes a key; every output bit depends on every input bit.
inline std::uint32_t hash(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x21f0aaadu;
  x ^= x >> 15;
  x *= 0xd35a2d97u;
  return x ^ (x >> 15);
}
inline std::uint32_t hash(std::uint32_t a, std::uint32_t b) {
  return hash(a ^ (hash(b) + 0x9e3779b9u));
}
inline std::uint32_t hash(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  return hash(hash(a, b), c);
}

inline std::uint32_t reverse_bits(std::uint32_t x) {
  x = (x << 16) | (x >> 16);
  x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
  x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
  return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
}

/// Scrambles a 32-bit fraction by nested uniform (Owen) scrambling: flips each bit by a hash of the
/// bits above it, so that elementary intervals map to elementary intervals.
inline std::uint32_t owen_scramble(std::uint32_t fraction, std::uint32_t seed) {
  std::uint32_t x = reverse_bits(fraction);
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return reverse_bits(x);
}

/// A fraction of 2^32 as a float in [0, 1).
inline float to_unit(std::uint32_t fraction) {
  return float(fraction >> 8) * 0x1p-24f;
}

struct SobolPoint {
  std::uint32_t x = 0, y = 0;  ///< fractions of 2^32
};

/// The first two dimensions of Sobol's sequence: a (0,2)-sequence in base 2.
inline SobolPoint sobol(std::uint32_t index) {
  std::uint32_t y = 0;
  for (std::uint32_t v = 1u << 31, i = index; i; i >>= 1, v ^= v >> 1)
    if (i & 1) y ^= v;
  return {reverse_bits(index), y};
}

/// A point of the sequence that samples are drawn from: Sobol's, or independent ones.
inline SobolPoint sequence_point(std::uint32_t index, bool low_discrepancy) {
  return low_discrepancy ? sobol(index)
                         : SobolPoint{hash(index, 0x1f83d9abu), hash(index, 0x5be0cd19u)};
}

/// Returns an Owen-scrambled copy of a Sobol point: same stratification, errors of two seeds
/// independent.
inline math::Vec2 scrambled(SobolPoint p, std::uint32_t seed) {
  return {to_unit(owen_scramble(p.x, seed)), to_unit(owen_scramble(p.y, hash(seed)))};
}

/// Returns sample `index` of the two-dimensional sequence that `seed` names (padded sampling). Two
/// seeds give sequences in independent order, so any number of pairs may be combined.
inline math::Vec2 sample_pair(std::uint32_t index, std::uint32_t seed) {
  // Scrambling the index as a fraction keeps aligned blocks together, so every block of a power of
  // two samples is a net.
  return scrambled(sobol(owen_scramble(index, hash(seed, 0x68bc21ebu))), hash(seed, 0x02e5be93u));
}

}  // namespace kiln::sampling
