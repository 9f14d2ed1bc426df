#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "baker/exec/workers.h"
#include "baker/trace/ray_scene.h"
#include "proto/expected.h"

/// Visibility as a service of its own [RTRad 7.3]: which of many pairs of points see each other.
namespace kiln::visibility {

/// A pair is six little-endian IEEE 754 floats: x, y, z of the one point, then of the other;
/// meters, in the world space of the scene.
inline constexpr std::size_t kPairBytes = 24;
/// The most pairs that are answered at once.
inline constexpr std::uint32_t kMostPairs = 1'000'000;
/// The largest coordinate of a point, m: a thousand times the largest that a scene has.
inline constexpr float kMostMeters = 1e12f;

/// Returns the number of bytes that answer so many pairs.
constexpr std::size_t answer_bytes(std::size_t pairs) {
  return (pairs + 7) / 8;
}

/// Checks bytes that come from outside: they have to be at most kMostPairs whole pairs of points
/// that are numbers within kMostMeters. `first` is the number of the first pair, for messages.
/// Errors: `invalid_request`, at /body or the first number that is wrong (/body/12/5: the last one
/// of the thirteenth pair), and `canceled`.
proto::Expected<void> check_pairs(std::string_view bytes, const exec::Workers&,
                                  std::uint64_t first = 0);

struct Answer {
  /// One bit per pair: bit i % 8 of byte i / 8, where bit 0 is worth 1, is 1 when the points of
  /// pair i see each other. The last byte is filled up with 0.
  std::string bits;
  std::uint64_t visible = 0;  ///< number of the bits that are 1
  double cpu_seconds = 0;     ///< of all threads together
};

/// Answers pairs that check_pairs() has let pass. Points see each other when no triangle, from
/// whichever side, lies between them; trace::RayVisibility says how near to a point one does not
/// count. Materials play no part, as in a bake's shadow rays. The bits hang on the arguments alone,
/// not on the number of threads. Errors: `canceled`, within a second of a stop request.
proto::Expected<Answer> see(const trace::RayScene&, std::string_view pairs, const exec::Workers&);

}  // namespace kiln::visibility
