#include "baker/solver/directional/ring_order.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace kiln::solver::directional {

RingOrder::RingOrder(const sampling::HemisphereSet& from) {
  const std::uint32_t count = from.size();
  // As wide as the directions are apart.
  const auto widths = std::max(1u, std::uint32_t(std::sqrt(float(count) / math::kPi) + 0.5f));
  std::vector<std::uint32_t> ring(count), order(count);
  std::vector<float> angle(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    const float r = std::sqrt(from.x[i] * from.x[i] + from.y[i] * from.y[i]);
    ring[i] = std::min(widths - 1, std::uint32_t(r * float(widths)));
    angle[i] = std::atan2(from.y[i], from.x[i]);
  }
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return ring[a] != ring[b] ? ring[a] < ring[b] : angle[a] < angle[b];
  });
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t k = order[i];
    set.add({from.x[k], from.y[k], from.z[k]}, from.weight[k], from.contrast[k]);
    solid_angle.push_back(from.solid_angle(k));
    if (i == 0 || ring[k] != ring[order[i - 1]]) rings.push_back({i, 0});
    ++rings.back().size;
  }
}

}  // namespace kiln::solver::directional
