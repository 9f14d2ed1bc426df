#include "baker/visibility/pairs.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>

#include "baker/exec/cpu_time.h"
#include "baker/trace/visibility.h"

namespace kiln::visibility {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr std::uint32_t kNumbers = 6;  ///< of a pair
constexpr std::uint32_t kLanes = 16;   ///< of a packet
/// Pairs of a batch: some milliseconds of one thread. Whole packets and whole bytes.
constexpr std::uint32_t kBatch = 4096;

proto::Unexpected wrong(const std::string& pointer, const std::string& why) {
  return proto::fail("invalid_request", why, "request", "/body" + pointer);
}

void read(std::string_view bytes, std::uint32_t pair, std::uint32_t count, float* numbers) {
  std::memcpy(numbers, bytes.data() + std::size_t{pair} * kPairBytes, count * kPairBytes);
}

bool is_fine(float number) {
  return std::abs(number) <= kMostMeters;  // false where it is not a number
}

/// Returns the first number of a range of pairs that is not fine, counted from the first of all;
/// UINT32_MAX when there is none.
std::uint32_t first_wrong(std::string_view bytes, std::uint32_t begin, std::uint32_t end) {
  float numbers[kNumbers * kLanes];
  for (std::uint32_t at = begin; at < end; at += kLanes) {
    const std::uint32_t count = std::min(kLanes, end - at);
    read(bytes, at, count, numbers);
    bool fine = true;
    for (std::uint32_t i = 0; i < kNumbers * count; ++i) fine &= is_fine(numbers[i]);
    if (fine) continue;
    const auto* wrong = std::find_if_not(numbers, numbers + kNumbers * count, is_fine);
    return at * kNumbers + std::uint32_t(wrong - numbers);
  }
  return UINT32_MAX;
}

void lower(std::atomic<std::uint32_t>& least, std::uint32_t value) {
  std::uint32_t seen = least;
  while (value < seen && !least.compare_exchange_weak(seen, value)) {
  }
}

/// Returns the bits of up to sixteen pairs.
std::uint32_t see_packet(const trace::RayVisibility& visibility, std::string_view bytes,
                         std::uint32_t first, std::uint32_t count) {
  float numbers[kNumbers * kLanes];
  read(bytes, first, count, numbers);
  trace::SegmentPacket packet;
  for (std::uint32_t i = 0; i < count; ++i) {
    const float* n = numbers + kNumbers * i;
    packet.add({n[0], n[1], n[2]}, {n[3], n[4], n[5]});
  }
  return ~visibility.blocked(packet) & ((1u << count) - 1);
}

}  // namespace

proto::Expected<void> check_pairs(std::string_view bytes, const exec::Workers& workers,
                                  std::uint64_t first) {
  if (bytes.size() % kPairBytes != 0)
    return wrong("", "The pairs have " + std::to_string(bytes.size()) +
                         " bytes, which is no multiple of 24: a pair has six floats of 4 bytes.");
  if (bytes.size() / kPairBytes > kMostPairs)
    return wrong("", "There are " + std::to_string(bytes.size() / kPairBytes) + " pairs; at most " +
                         std::to_string(kMostPairs) + " are answered at once.");
  const auto count = std::uint32_t(bytes.size() / kPairBytes);
  std::atomic<std::uint32_t> least{UINT32_MAX};
  if (!workers.for_runs(count, kBatch, [&](std::uint32_t begin, std::uint32_t end) {
        lower(least, first_wrong(bytes, begin, end));
      }))
    return proto::canceled();
  if (least == UINT32_MAX) return {};
  const std::uint64_t pair = first + least / kNumbers;
  const std::uint32_t number = least % kNumbers;
  return wrong("/" + std::to_string(pair) + "/" + std::to_string(number),
               "A coordinate has to be a number, at most 1e12 m from 0: number " +
                   std::to_string(number) + " of pair " + std::to_string(pair) + " is not.");
}

proto::Expected<Answer> see(const trace::RayScene& rays, std::string_view pairs,
                            const exec::Workers& workers) {
  const auto count = std::uint32_t(pairs.size() / kPairBytes);
  const trace::RayVisibility visibility(rays, /*coherent=*/false);
  Answer answer;
  answer.bits.resize(answer_bytes(count));
  std::atomic<std::uint64_t> visible{0};
  std::atomic<double> cpu_seconds{0};
  if (!workers.for_runs(count, kBatch, [&](std::uint32_t begin, std::uint32_t end) {
        const double began = exec::thread_seconds();
        std::uint64_t seen = 0;
        for (std::uint32_t at = begin; at < end; at += kLanes) {
          const std::uint32_t lanes = std::min(kLanes, end - at);
          const std::uint32_t bits = see_packet(visibility, pairs, at, lanes);
          seen += std::uint64_t(std::popcount(bits));
          answer.bits[at / 8] = static_cast<char>(bits & 0xff);
          if (lanes > 8) answer.bits[at / 8 + 1] = static_cast<char>(bits >> 8);
        }
        visible += seen;
        cpu_seconds += exec::thread_seconds() - began;
      }))
    return proto::canceled();
  answer.visible = visible;
  answer.cpu_seconds = cpu_seconds;
  return answer;
}

}  // namespace kiln::visibility
