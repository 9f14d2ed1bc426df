#include "baker/solver/adaptive/allocation.h"

#include <algorithm>
#include <cmath>

namespace kiln::solver::adaptive {
namespace {

struct Choice {
  std::uint32_t doublings = 0;
  double variance = 0;  ///< afterwards
};

/// The law by which the variance of a unit falls.
struct Fall {
  double slope, by_doubling;  ///< factor of one doubling

  explicit Fall(double s) : slope(s), by_doubling(std::exp2(-2 * s)) {}
  double left(double had, double more) const {
    return more < had ? std::pow(1 + more / had, -2 * slope) : by_doubling;
  }
};

Choice at_price(const AllocationUnit& unit, double price, const Fall& fall) {
  Choice c{0, unit.variance};
  for (double had = unit.samples; had > 0 && had < unit.most;) {
    const double more = std::min(had, unit.most - had), left = fall.left(had, more);
    if (!(c.variance * (1 - left) > price * more * unit.cost)) break;
    c.variance *= left, had += more;
    ++c.doublings;
  }
  return c;
}

}  // namespace

std::vector<std::uint32_t> allocate_samples(std::span<const AllocationUnit> units, double allowed,
                                            double slope) {
  const Fall fall(slope);
  const auto variance_at = [&](double price) {
    double sum = 0;
    for (const AllocationUnit& unit : units) sum += at_price(unit, price, fall).variance;
    return sum;
  };
  constexpr double kNearLeast = 1.25;
  if (const double least = variance_at(0); least > allowed) allowed = kNearLeast * least;
  // The price at which no unit doubles any more.
  double high = 0;
  for (const AllocationUnit& unit : units) {
    const double more = std::min(unit.samples, unit.most - unit.samples);
    if (unit.cost > 0 && more > 0)
      high =
          std::max(high, unit.variance * (1 - fall.left(unit.samples, more)) / (more * unit.cost));
  }
  std::vector<std::uint32_t> doublings(units.size());
  if (!(high > 0) || variance_at(high) <= allowed) return doublings;
  double low = high;
  constexpr int kSteps = 60;  // of a factor of 4, far below the price of any last doubling
  for (int i = 0; i < kSteps && variance_at(low) > allowed; ++i) high = low, low /= 4;
  for (int i = 0; i < kSteps; ++i) {
    const double price = std::sqrt(low * high);
    (variance_at(price) > allowed ? high : low) = price;
  }
  for (std::size_t i = 0; i < units.size(); ++i)
    doublings[i] = at_price(units[i], low, fall).doublings;
  return doublings;
}

}  // namespace kiln::solver::adaptive
