#include "baker/light/sky_light.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <span>

#include "baker/exec/stop.h"

namespace kiln::light {
namespace {

/// A smaller share of the light than this is not worth rays of its own.
constexpr double kWorthwhile = 1e-3;
/// The sums can't be divided by less than this.
constexpr double kLeastExcess = 1e-30;

/// cosθ at the edges of the rows.
std::vector<double> edge_cosines(std::uint32_t rows) {
  std::vector<double> edges;
  for (std::uint32_t y = 0; y <= rows; ++y) edges.push_back(std::cos(std::numbers::pi * y / rows));
  return edges;
}

/// Runs on the workers when there are any. Returns false when stopped.
bool for_runs(const exec::Workers* workers, std::uint32_t count,
              const std::function<void(std::uint32_t, std::uint32_t)>& use) {
  constexpr std::uint32_t kRows = 4;
  if (workers) return workers->for_runs(count, kRows, use);
  use(0, count);
  return true;
}

/// The interval that holds `u`, given the ends of all intervals, and the place within it, [0, 1).
struct Place {
  std::size_t index;
  float within;
};
Place find(std::span<const float> ends, float u) {
  const auto at = std::upper_bound(ends.begin(), ends.end() - 1, u);
  const float begin = at == ends.begin() ? 0 : *(at - 1);
  return {std::size_t(at - ends.begin()),
          std::clamp((u - begin) / (*at - begin), 0.f, 0x0.ffffffp0f)};
}

}  // namespace

SkyLight::SkyLight(const scene::Scene& scene, const exec::Workers* workers)
    : uniform_(scene.sky), map_(scene.sky_map), edge_cosines_(edge_cosines(map_.height)) {
  const std::size_t width = map_.width;
  // Calls `use(row, solid angle of each of its pixels)`; what it gives is summed in order.
  std::vector<double> of_row(map_.height);
  const auto for_rows = [&](const auto& use) {
    return for_runs(workers, map_.height, [&](std::uint32_t begin, std::uint32_t end) {
      for (std::size_t y = begin; y < end; ++y)
        of_row[y] = use(
            y, (edge_cosines_[y] - edge_cosines_[y + 1]) * 2 * std::numbers::pi / double(width));
    });
  };
  const auto power_of_row = [&](std::size_t y, double sr) {
    double sum = 0;
    for (std::size_t x = 0; x < width; ++x) sum += double(luminance(map_.texels[y * width + x]));
    return sum * sr;
  };
  if (!for_rows(power_of_row)) return;
  const double power = std::accumulate(of_row.begin(), of_row.end(), 0.0);
  const double sphere = 4 * std::numbers::pi;
  floor_ = float(power / sphere);
  const std::stop_token stop = workers ? workers->stop : std::stop_token();
  if (!exec::grow_unless_stopped(pixel_ends_, map_.texels.size(), stop)) return;
  const auto excess_of_row = [&](std::size_t y, double sr) {
    double sum = 0, below = 0;
    const std::size_t begin = y * width, end = begin + width;
    for (std::size_t i = begin; i < end; ++i) sum += double(excess(i));
    for (std::size_t i = begin; i < end && sum > 0; ++i)
      pixel_ends_[i] = float((below += double(excess(i))) / sum);
    return sum * sr;
  };
  if (!for_rows(excess_of_row)) return;
  std::partial_sum(of_row.begin(), of_row.end(), of_row.begin());
  const double all = of_row.back();
  const double uniform = double(luminance(uniform_)) * sphere / double(map_.scale);
  if (all <= std::max(kLeastExcess, kWorthwhile * (power + uniform))) {
    pixel_ends_ = {};
    return;
  }
  per_excess_ = float(1 / all);
  for (const double end : of_row) row_ends_.push_back(float(end / all));
}

SkyLight::Seen SkyLight::seen(std::size_t pixel) const {
  const math::Rgb c = map_.texels[pixel];
  return {uniform_ + c * map_.scale, per_excess_ * excess(pixel)};
}

SkyLight::Seen SkyLight::seen(math::Vec3 d) const {
  const float theta = std::atan2(std::sqrt(d.x * d.x + d.z * d.z), d.y);
  float turn = (std::atan2(d.z, d.x) + map_.rotation) / (2 * math::kPi) + 0.5f;
  turn -= std::floor(turn);
  const auto y = std::min(map_.height - 1, std::uint32_t(theta / math::kPi * float(map_.height)));
  const auto x = std::min(map_.width - 1, std::uint32_t(turn * float(map_.width)));
  return seen(std::size_t(y) * map_.width + x);
}

SkyLight::Sample SkyLight::sample(math::Vec2 u) const {
  const Place row = find(row_ends_, u.y);
  const std::size_t first = row.index * map_.width;
  const Place column = find(std::span(pixel_ends_).subspan(first, map_.width), u.x);
  // This is in double precision: close to the pole, what is left of 1 is the sine.
  const double top = edge_cosines_[row.index], bottom = edge_cosines_[row.index + 1];
  const double up = top + (bottom - top) * double(row.within);
  const double flat = std::sqrt(std::max(0., (1 - up) * (1 + up)));
  const float turn = (float(column.index) + column.within) / float(map_.width) - 0.5f;
  const float phi = turn * 2 * math::kPi - map_.rotation;
  return {{float(flat) * std::cos(phi), float(up), float(flat) * std::sin(phi)},
          seen(first + column.index)};
}

}  // namespace kiln::light
