#include "baker/sampling/direction_set.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "baker/sampling/sobol.h"

namespace kiln::sampling {
namespace {

bool is_net(std::uint32_t first, std::uint32_t count) {
  return std::has_single_bit(count) && first % count == 0;
}

/// Groups the points of a (0,2)-net by elementary cells of 16 points each, as square as can be.
/// Owen scrambling maps cells to cells, so the groups stay narrow for every texel's own scramble.
/// Within a cell the order is that of the sequence, so each half of the net has its half of it.
void sort_by_cells(std::vector<std::uint32_t>& order) {
  const int bits = std::countr_zero(order.size()) - 4, x_bits = (bits + 1) / 2, y_bits = bits / 2;
  const auto cell = [&](std::uint32_t i) {
    const SobolPoint p = sobol(i);
    const std::uint32_t y = y_bits > 0 ? p.y >> (32 - y_bits) : 0;
    return (p.x >> (32 - x_bits)) << y_bits | y;
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return cell(a) < cell(b); });
}

/// Gives each packet eight points of the first half of the sequence and eight of the second.
void deal_halves(std::vector<std::uint32_t>& order) {
  const std::vector<std::uint32_t> sequence = order;
  const std::size_t half = sequence.size() / 2;
  for (std::size_t i = 0; i < sequence.size(); ++i)
    order[i] = sequence[i / 16 * 8 + i % 8 + (i & 8 ? half : 0)];
}

}  // namespace

DirectionSet::DirectionSet(std::uint32_t from, std::uint32_t n, bool sorted, bool low_discrepancy)
    : first(from),
      count(n),
      coherent(sorted && low_discrepancy && n >= kCoherentSamples && is_net(from, n)),
      is_low_discrepancy(low_discrepancy) {
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), first);
  if (coherent)
    sort_by_cells(order);
  else if (n % 16 == 0)
    deal_halves(order);
  for (std::uint32_t i : order) {
    const SobolPoint p = sequence_point(i, low_discrepancy);
    x.push_back(p.x);
    y.push_back(p.y);
  }
  x.resize((n + 15) / 16 * 16);
  y.resize(x.size());
  count_halves();
}

void DirectionSet::count_halves() {
  first_half_ = 0;
  for (std::uint32_t i = 0; i < count; ++i) first_half_ += !in_second_half(i);
}

DirectionSet DirectionSet::leading(std::uint32_t n) const {
  DirectionSet some = *this;
  some.count = n;
  some.x.resize((n + 15) / 16 * 16);
  some.y.resize(some.x.size());
  some.count_halves();
  return some;
}

Estimate DirectionSet::estimate(math::Rgb first_sum, math::Rgb second_sum) const {
  const auto n = float(count), a = float(first_half_), b = n - a;
  Estimate e;
  e.mean = (first_sum + second_sum) * (1 / n);
  if (b == 0) {
    e.half_difference = luminance(e.mean);
  } else {
    const float half =
        (luminance(first_sum) / a - luminance(second_sum) / b) * std::sqrt(a * b) / n;
    e.half_difference = half * (is_low_discrepancy ? kNetCorrection : 1);
  }
  return e;
}

}  // namespace kiln::sampling
