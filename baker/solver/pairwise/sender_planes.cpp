#include "baker/solver/pairwise/sender_planes.h"

#include <algorithm>

#include "baker/solver/emittance.h"
#include "baker/solver/pairwise/pairwise.h"
#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pairwise/quadtree.h"

namespace kiln::solver::pairwise {
namespace {

/// Texels, or windows, between two looks at the stop token.
constexpr std::uint32_t kLook = 4096;

constexpr double kWindowBytes = 16, kLeafBytes = 16;  ///< per texel, as SenderStrategy counts them

/// Calls `use(i)` for 0 to `count`. Returns false when stopped.
template <class Use>
bool for_all(std::uint32_t count, const std::stop_token& stop, const Use& use) {
  for (std::uint32_t i = 0; i < count; ++i) {
    if (i % kLook == 0 && stop.stop_requested()) return false;
    use(i);
  }
  return !stop.stop_requested();
}

/// A sum weighted by area.
struct Weighted {
  double area = 0;
  math::Vec3d sum;

  void add(math::Rgb value, float area_m2) {
    const double a = double(area_m2);
    area += a;
    sum += math::Vec3d{value.r, value.g, value.b} * a;
  }
  math::Rgb mean() const {
    if (!(area > 0)) return {};
    const math::Vec3d mean = sum * (1 / area);
    return {float(mean.x), float(mean.y), float(mean.z)};
  }
};

}  // namespace

std::optional<std::vector<math::Rgb>> texel_radiosity(
    const World& world, const std::function<math::Rgb(std::uint32_t)>& irradiance,
    const std::stop_token& stop) {
  const bool shines = emitters_send(world.settings);
  std::vector<math::Rgb> out(world.texels.size());
  const bool whole = for_all(world.texels.size(), stop, [&](std::uint32_t t) {
    out[t] = world.texels.albedo[t] * world.settings.reflectivity_factor * irradiance(t);
    if (shines) out[t] += texel_emittance(world, t);
  });
  return whole ? std::optional(std::move(out)) : std::nullopt;
}

std::optional<std::vector<math::Rgb>> window_means(const World& world,
                                                   std::span<const math::Rgb> radiosity,
                                                   const std::stop_token& stop) {
  const atlas::TextureGroup& texels = world.texels;
  const Windows windows(texels, window_texels(world.settings, world.atlas.page_size), stop);
  if (stop.stop_requested()) return std::nullopt;
  std::vector<math::Rgb> out(texels.size());
  std::vector<std::uint32_t> own;
  const bool whole = for_all(windows.size(), stop, [&](std::uint32_t w) {
    own.assign(windows.texels(w).begin(), windows.texels(w).end());
    const auto chart = [&](std::uint32_t t) { return texels.chart[t]; };
    std::ranges::stable_sort(own, {}, chart);
    for (std::size_t begin = 0, end = 0; begin < own.size(); begin = end) {
      Weighted mean;
      for (; end < own.size() && chart(own[end]) == chart(own[begin]); ++end)
        mean.add(radiosity[own[end]], texels.area_m2[own[end]]);
      for (std::size_t i = begin; i < end; ++i) out[own[i]] = mean.mean();
    }
  });
  return whole ? std::optional(std::move(out)) : std::nullopt;
}

std::optional<std::vector<std::uint8_t>> leaf_sides(const World& world,
                                                    std::span<const math::Rgb> radiosity,
                                                    const std::stop_token& stop) {
  const std::uint32_t side = world.settings.subdivision_max_node;
  const Patches patches(world, world.settings.pair_samples, stop);
  if (stop.stop_requested()) return std::nullopt;
  const Windows windows(world.texels, side, stop);
  if (stop.stop_requested()) return std::nullopt;
  const Quadtree tree(world.texels, patches, windows, side, radiosity,
                      world.settings.subdivision_threshold.value_or(kUsualThreshold), stop);
  if (stop.stop_requested()) return std::nullopt;
  std::vector<std::uint8_t> out(world.texels.size());
  for (const Quadtree::Leaf& leaf : tree.leaves())
    for (const std::uint32_t t : tree.texels(leaf)) out[t] = std::uint8_t(leaf.side);
  return out;
}

std::optional<std::vector<float>> sent_areas(const World& world,
                                             std::span<const math::Rgb> radiosity,
                                             const std::stop_token& stop) {
  const Patches patches(world, world.settings.pair_samples, stop);
  if (stop.stop_requested()) return std::nullopt;
  const SenderStrategy strategy(world, patches, stop);
  if (stop.stop_requested()) return std::nullopt;
  std::vector<float> out(world.texels.size());
  const auto add = [&](const Senders& senders) {
    for (const Sender& sender : senders.list) out[sender.texel] += sender.area_m2;
  };
  if (!strategy.are_per_receiver()) {
    const auto senders = strategy.pick(radiosity, 0, stop);
    if (!senders) return std::nullopt;
    add(*senders);
    return out;
  }
  Senders own;
  std::uint32_t window = 0;
  do {
    if (stop.stop_requested()) return std::nullopt;
    window = strategy.pick_for(0, radiosity, 0, window, own);
    add(own);
  } while (window > 0);
  return out;
}

double window_means_memory(double texels) {
  return texels * (2 * sizeof(math::Rgb) + kWindowBytes);
}
double leaf_sides_memory(double texels, const proto::SolverSettings& settings) {
  return texels * (sizeof(math::Rgb) + Patches::memory_per_texel(settings.pair_samples) +
                   kWindowBytes + kLeafBytes + sizeof(std::uint8_t));
}
double sent_areas_memory(double texels, const proto::SolverSettings& settings) {
  return texels * (Patches::memory_per_texel(settings.pair_samples) +
                   SenderStrategy::memory_per_texel(settings) + sizeof(float));
}

}  // namespace kiln::solver::pairwise
