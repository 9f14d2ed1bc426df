#include "baker/solver/sample_budget.h"

#include <algorithm>
#include <cmath>

namespace kiln::baker {
namespace {

struct Choice {
  std::uint32_t doublings = 0;
  double variance = 0;  ///< afterwards
};

/// @param left of the variance after one doubling
Choice at_price(const SampleLot& lot, double price, double left) {
  Choice c{0, lot.variance};
  double samples = lot.samples;
  while (samples > 0 && 2 * samples <= lot.most &&
         c.variance * (1 - left) > price * samples * lot.cost) {
    c.variance *= left, samples *= 2;
    ++c.doublings;
  }
  return c;
}

}  // namespace

std::vector<std::uint32_t> least_doublings(std::span<const SampleLot> lots, double allowed,
                                           double slope) {
  const double left = std::exp2(-2 * slope);
  const auto variance_at = [&](double price) {
    double sum = 0;
    for (const SampleLot& lot : lots) sum += at_price(lot, price, left).variance;
    return sum;
  };
  // The price at which no lot doubles any more.
  double high = 0;
  for (const SampleLot& lot : lots)
    if (lot.cost > 0 && lot.samples > 0)
      high = std::max(high, lot.variance * (1 - left) / (lot.samples * lot.cost));
  std::vector<std::uint32_t> doublings(lots.size());
  if (!(high > 0) || variance_at(high) <= allowed) return doublings;
  double low = high;
  constexpr int kSteps = 60;  // of a factor of 4, far below the price of any last doubling
  for (int i = 0; i < kSteps && variance_at(low) > allowed; ++i) high = low, low /= 4;
  for (int i = 0; i < kSteps; ++i) {
    const double price = std::sqrt(low * high);
    (variance_at(price) > allowed ? high : low) = price;
  }
  for (std::size_t i = 0; i < lots.size(); ++i)
    doublings[i] = at_price(lots[i], low, left).doublings;
  return doublings;
}

}  // namespace kiln::baker
