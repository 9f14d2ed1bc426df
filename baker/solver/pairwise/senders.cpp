#include "baker/solver/pairwise/senders.h"

#include <algorithm>
#include <limits>
#include <tuple>

#include "baker/sampling/sobol.h"
#include "baker/solver/pairwise/quadtree.h"

namespace kiln::solver::pairwise {
namespace {

using proto::SenderSeed;
using proto::Undersampling;

/// What is the same for all draws of a bake, and what differs with the receiver.
constexpr std::uint32_t kCharts = 0x63686172, kReceivers = 0x72656376;

std::optional<Windows> windows_of(const World& world, const Patches& patches,
                                  const std::stop_token& stop) {
  const proto::SolverSettings& s = world.settings;
  if (s.undersampling != Undersampling::kNone) {
    if (patches.window() == 1) return std::nullopt;
    return Windows(world.texels, patches.window(), stop);
  }
  if (s.subdivision_threshold) return Windows(world.texels, s.subdivision_max_node, stop);
  return std::nullopt;
}

void add(const Sender& sender, Senders& to) {
  if (!is_black(sender.radiosity)) to.list.push_back(sender);
}

/// Sums over some texels, weighted by area.
struct Mean {
  double area = 0;
  math::Vec3d position, origin, normal, radiosity;

  Mean(std::span<const std::uint32_t> texels, const Patches& patches,
       std::span<const math::Rgb> light) {
    for (const std::uint32_t t : texels) {
      const double a = patches.area_m2(t);
      const Point point = patches.middle(t);
      area += a;
      position += to_double(point.position) * a;
      origin += to_double(point.origin) * a;
      normal += to_double(point.geometric_normal) * a;
      radiosity += math::Vec3d{light[t].r, light[t].g, light[t].b} * a;
    }
  }
  math::Vec3 of(const math::Vec3d& sum) const {
    const math::Vec3d mean = sum * (1 / area);
    return {float(mean.x), float(mean.y), float(mean.z)};
  }
  math::Rgb light() const {
    const math::Vec3 mean = of(radiosity);
    return {mean.x, mean.y, mean.z};
  }
};

std::uint32_t nearest(std::span<const std::uint32_t> texels, math::Vec3 to,
                      const Patches& patches) {
  std::uint32_t best = texels.front();
  float least = std::numeric_limits<float>::infinity();
  for (const std::uint32_t t : texels) {
    const math::Vec3 way = patches.middle(t).position - to;
    if (const float square = dot(way, way); square < least) least = square, best = t;
  }
  return best;
}

}  // namespace

void Senders::gather(const Patches& patches) {
  if (patches.pair_samples() > 1) return;
  columns.resize(list.size());
  for (std::size_t s = 0; s < list.size(); ++s) {
    Patch patch = patches.patch(list[s].texel);
    patch.area_m2 = list[s].area_m2;
    if (list[s].point != Sender::kTexelsOwn) patch.point = points[list[s].point], patch.visible = 1;
    columns.set(s, patch);
  }
}

SenderStrategy::SenderStrategy(const World& world, const Patches& patches,
                               const std::stop_token& stop)
    : texels_(world.texels),
      patches_(patches),
      settings_(world.settings),
      seed_(sampling::hash(std::uint32_t(world.settings.seed),
                           std::uint32_t(world.settings.seed >> 32))),
      windows_(windows_of(world, patches, stop)) {}

double SenderStrategy::memory_per_texel(const proto::SolverSettings& settings) {
  constexpr double kWindows = 4 * sizeof(std::uint32_t), kLeaves = 4 * sizeof(std::uint32_t);
  double bytes = sizeof(math::Rgb) + sizeof(Sender) + PatchColumns::kBytes;
  if (settings.undersampling != Undersampling::kNone || settings.subdivision_threshold)
    bytes += kWindows;
  if (settings.undersampling == Undersampling::kMipmap) bytes += sizeof(Point) / 2.0;
  if (settings.subdivision_threshold) bytes += kLeaves;
  return bytes;
}

bool SenderStrategy::are_per_receiver() const {
  return windows_ && settings_.undersampling == Undersampling::kMonteCarlo &&
         settings_.sender_seed == SenderSeed::kReceiver;
}

double SenderStrategy::expected() const {
  return windows_ && !settings_.subdivision_threshold ? windows_->size() : texels_.size();
}

std::optional<Senders> SenderStrategy::pick(std::span<const math::Rgb> radiosity,
                                            std::uint32_t bounce,
                                            const std::stop_token& stop) const {
  constexpr std::uint32_t kLook = 4096;  // windows
  Senders senders;
  if (!windows_) {
    add_all(radiosity, senders);
  } else if (settings_.undersampling == Undersampling::kNone) {
    if (!add_leaves(radiosity, bounce, stop, senders)) return std::nullopt;
  } else {
    for (std::uint32_t w = 0; w < windows_->size(); ++w) {
      if (w % kLook == 0 && stop.stop_requested()) return std::nullopt;
      if (settings_.undersampling == Undersampling::kStride)
        add_first(w, radiosity, senders);
      else if (settings_.undersampling == Undersampling::kMonteCarlo)
        add_drawn(w, sampling::hash(seed_, bounce), radiosity, senders);
      else
        add_means(w, radiosity, senders);
    }
  }
  senders.gather(patches_);
  return senders;
}

std::uint32_t SenderStrategy::pick_for(std::uint32_t receiver, std::span<const math::Rgb> radiosity,
                                       std::uint32_t bounce, std::uint32_t first,
                                       Senders& senders) const {
  constexpr std::uint32_t kPiece = 2048;  // windows
  senders.clear();
  const std::uint32_t seed = sampling::hash(seed_ ^ kReceivers, bounce, receiver);
  const std::uint32_t end = first + std::min(kPiece, windows_->size() - first);
  for (std::uint32_t w = first; w < end; ++w) add_drawn(w, seed, radiosity, senders);
  senders.gather(patches_);
  return end < windows_->size() ? end : 0;
}

void SenderStrategy::add_all(std::span<const math::Rgb> radiosity, Senders& senders) const {
  for (std::uint32_t t = 0; t < texels_.size(); ++t)
    add({t, Sender::kTexelsOwn, texels_.area_m2[t], radiosity[t]}, senders);
}

void SenderStrategy::add_first(std::uint32_t window, std::span<const math::Rgb> radiosity,
                               Senders& senders) const {
  const float u = sampling::to_unit(sampling::hash(seed_ ^ kCharts, windows_->place(window)));
  std::uint32_t first = windows_->texel_at(window, u);
  const auto place = [&](std::uint32_t t) { return std::tie(texels_.y[t], texels_.x[t]); };
  for (const std::uint32_t t : windows_->texels(window))
    if (texels_.chart[t] == texels_.chart[first] && place(t) < place(first)) first = t;
  add({first, Sender::kTexelsOwn, windows_->area_m2(window), radiosity[first]}, senders);
}

void SenderStrategy::add_drawn(std::uint32_t window, std::uint32_t seed,
                               std::span<const math::Rgb> radiosity, Senders& senders) const {
  const float u = sampling::to_unit(sampling::hash(seed, windows_->place(window)));
  const std::uint32_t t = windows_->texel_at(window, u);
  add({t, Sender::kTexelsOwn, windows_->area_m2(window), radiosity[t]}, senders);
}

void SenderStrategy::add_means(std::uint32_t window, std::span<const math::Rgb> radiosity,
                               Senders& senders) const {
  const std::span<const std::uint32_t> all = windows_->texels(window);
  const auto chart = [&](std::uint32_t t) { return texels_.chart[t]; };
  if (std::ranges::all_of(all, [&](auto t) { return chart(t) == chart(all.front()); }))
    return add_mean(all, radiosity, senders);
  std::vector<std::uint32_t> texels(all.begin(), all.end());
  std::ranges::stable_sort(texels, {}, chart);
  for (std::size_t begin = 0, end = 0; begin < texels.size(); begin = end) {
    while (end < texels.size() && chart(texels[end]) == chart(texels[begin])) ++end;
    add_mean(std::span(texels).subspan(begin, end - begin), radiosity, senders);
  }
}

void SenderStrategy::add_mean(std::span<const std::uint32_t> texels,
                              std::span<const math::Rgb> radiosity, Senders& senders) const {
  if (texels.size() == 1) {
    const std::uint32_t t = texels.front();
    return add({t, Sender::kTexelsOwn, texels_.area_m2[t], radiosity[t]}, senders);
  }
  const Mean mean(texels, patches_, radiosity);
  const math::Rgb light = mean.area > 0 ? mean.light() : math::Rgb();
  if (is_black(light)) return;
  Point point;
  point.position = mean.of(mean.position);
  const std::uint32_t texel = nearest(texels, point.position, patches_);
  const math::Vec3 normal = patches_.middle(texel).geometric_normal;
  point.geometric_normal = point.shading_normal = normalize(mean.of(mean.normal), normal);
  // Up to the height of the highest texel.
  point.origin = mean.of(mean.origin);
  float height = 0;
  for (const std::uint32_t t : texels)
    height =
        std::max(height, dot(patches_.middle(t).origin - point.origin, point.geometric_normal));
  point.origin = point.origin + point.geometric_normal * height;
  senders.list.push_back({texel, std::uint32_t(senders.points.size()), float(mean.area), light});
  senders.points.push_back(point);
}

bool SenderStrategy::add_leaves(std::span<const math::Rgb> radiosity, std::uint32_t bounce,
                                const std::stop_token& stop, Senders& senders) const {
  const float threshold =
      *settings_.subdivision_threshold + settings_.subdivision_ramp * float(bounce);
  const Quadtree tree(texels_, patches_, *windows_, settings_.subdivision_max_node, radiosity,
                      threshold, stop);
  if (stop.stop_requested()) return false;
  for (const Quadtree::Leaf& leaf : tree.leaves()) {
    const auto texels = tree.texels(leaf);
    if (texels.size() == 1) {
      const std::uint32_t t = texels.front();
      add({t, Sender::kTexelsOwn, texels_.area_m2[t], radiosity[t]}, senders);
      continue;
    }
    const Mean mean(texels, patches_, radiosity);
    if (!(mean.area > 0)) continue;
    add({nearest(texels, mean.of(mean.position), patches_), Sender::kTexelsOwn, float(mean.area),
         mean.light()},
        senders);
  }
  return true;
}

}  // namespace kiln::solver::pairwise
