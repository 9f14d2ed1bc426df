#include "baker/output/lamps.h"

#include <algorithm>
#include <cmath>

#include "baker/exec/stop.h"

namespace kiln::output {
namespace {

/// Where more than this share of the texels are lamps, nothing is looked for behind them.
constexpr std::uint32_t kOneInFew = 10;
/// A lamp against a texel fills most of what the texel sees.
constexpr float kLeastShare = 0.5f;

/// Lamps by their place in space, to find those near a point.
class LampGrid {
 public:
  LampGrid(const atlas::TextureGroup& texels, const std::vector<std::uint32_t>& lamps,
           const TexelValue& emission)
      : texels_(texels) {
    for (const std::uint32_t lamp : lamps) cell_ = std::max(cell_, side_of(lamp));
    for (const std::uint32_t lamp : lamps)
      entries_.push_back({key_of(place_of(texels_.position[lamp])), lamp,
                          math::kPi * max_channel(emission(lamp))});
    std::ranges::sort(entries_, {}, [](const Entry& e) { return std::pair(e.key, e.lamp); });
    least_ = std::ranges::min_element(entries_, {}, &Entry::exitance)->exitance;
  }

  /// Says whether a lamp lies against a texel with that irradiance, lx.
  bool covers(std::uint32_t texel, float irradiance) const {
    if (!(irradiance > kLeastShare * least_)) return false;
    const Place at = place_of(texels_.position[texel]);
    for (std::int64_t x = at.x - kReach; x <= at.x + kReach; ++x)
      for (std::int64_t y = at.y - kReach; y <= at.y + kReach; ++y)
        for (std::int64_t z = at.z - kReach; z <= at.z + kReach; ++z) {
          const std::uint64_t key = key_of({x, y, z});
          auto entry = std::ranges::lower_bound(entries_, key, {}, &Entry::key);
          for (; entry != entries_.end() && entry->key == key; ++entry)
            if (irradiance > kLeastShare * entry->exitance && is_against(texel, entry->lamp))
              return true;
        }
    return false;
  }

 private:
  struct Place {
    std::int64_t x, y, z;
  };
  struct Entry {
    std::uint64_t key;
    std::uint32_t lamp;
    float exitance;  ///< lm/m2
  };
  /// Cells to each side: what is against a texel lies within 1.25 cells.
  static constexpr std::int64_t kReach = 2;

  /// Returns the length of the texel's side, m.
  float side_of(std::uint32_t t) const {
    return std::sqrt(texels_.area_m2[t] / texels_.coverage[t]);
  }
  Place place_of(math::Vec3 p) const {
    const auto along = [&](float v) {
      return std::int64_t(std::clamp(std::floor(double(v) / double(cell_)), -1e15, 1e15));
    };
    return {along(p.x), along(p.y), along(p.z)};
  }
  /// Returns a number that far cells may share.
  static std::uint64_t key_of(Place p) {
    constexpr std::uint64_t kMask = (1u << 21) - 1;
    return (std::uint64_t(p.x) & kMask) << 42 | (std::uint64_t(p.y) & kMask) << 21 |
           (std::uint64_t(p.z) & kMask);
  }
  bool is_against(std::uint32_t texel, std::uint32_t lamp) const {
    const math::Vec3 n = texels_.shading_normal[texel];
    const math::Vec3 d = texels_.position[lamp] - texels_.position[texel];
    const float side = std::min(std::max(side_of(texel), side_of(lamp)), cell_);
    const float height = dot(d, n);
    return height > 1e-3f * side && height <= side && length(d - n * height) <= 0.75f * side &&
           std::abs(dot(n, texels_.shading_normal[lamp])) > 0.5f;
  }

  const atlas::TextureGroup& texels_;
  float cell_ = 0;
  float least_ = 0;
  std::vector<Entry> entries_;
};

}  // namespace

proto::Expected<std::vector<bool>> hidden_by_lamps(const atlas::TextureGroup& texels,
                                                   const TexelValue& irradiance,
                                                   const TexelValue& emission,
                                                   const std::stop_token& stop) {
  exec::StopPoll stopped(stop);
  std::vector<bool> hidden(texels.front_count, false);
  std::vector<std::uint32_t> lamps;
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    if (stopped()) return exec::canceled();
    hidden[t] = math::kPi * max_channel(emission(t)) > max_channel(irradiance(t));
    if (hidden[t] && lamps.size() <= texels.front_count / kOneInFew) lamps.push_back(t);
  }
  if (lamps.empty() || lamps.size() > texels.front_count / kOneInFew) return hidden;
  const LampGrid grid(texels, lamps, emission);
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    if (stopped()) return exec::canceled();
    if (!hidden[t] && grid.covers(t, max_channel(irradiance(t)))) hidden[t] = true;
  }
  return hidden;
}

}  // namespace kiln::output
