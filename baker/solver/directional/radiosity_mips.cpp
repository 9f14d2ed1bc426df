#include "baker/solver/directional/radiosity_mips.h"

#include <algorithm>

namespace kiln::solver::directional {
namespace {

/// Texels with less of their footprint in view than this read their neighbors' radiosity.
constexpr float kHiddenShare = 0.1f;
constexpr std::uint32_t kNone = 0xffffffffu;

}  // namespace

/// The squares of one level that may be parts of larger ones.
struct RadiosityMips::Level {
  struct Place {
    std::uint32_t square = 0;              ///< its index
    std::uint32_t chart = 0;               ///< twice the chart's number, and one more for its back
    std::uint16_t page = 0, x = 0, y = 0;  ///< in squares of the level
  };
  std::vector<Place> places;
  int shift = 0;  ///< log2 of a square's side, texels
};

bool RadiosityMips::read(const World& world, const lightmap::Lightmap& light,
                         std::span<const math::Rgb> emittance, const exec::Workers& workers) {
  constexpr std::uint32_t kRunTexels = 16384;
  const std::uint32_t texels = world.texels.size();
  // As many as nearly all atlases need: a level has about a quarter of the squares of that below.
  const std::size_t expected = texels + std::size_t(texels) / 2;
  squares_.reserve(expected), seen_m2_.reserve(expected), parent_.reserve(expected);
  squares_.assign(texels, {});
  seen_m2_.assign(texels, 0);
  if (!workers.for_runs(texels, kRunTexels, [&](std::uint32_t begin, std::uint32_t end) {
        read_texels(world, light, emittance, begin, end);
      }))
    return false;
  parent_.resize(texels);
  for (std::uint32_t t = 0; t < texels; ++t) parent_[t] = t;
  Level level = first_level(world);
  while (!level.places.empty() && level.shift < kCoarsest) {
    if (workers.stop.stop_requested()) return false;
    level = next_level(world, level);
  }
  for (std::size_t s = squares_.size(); s-- > 0;) {
    if (seen_m2_[s] > 0) continue;
    const Square& around = squares_[parent_[s]];
    squares_[s].r = around.r, squares_[s].g = around.g, squares_[s].b = around.b;
  }
  return true;
}

void RadiosityMips::read_texels(const World& world, const lightmap::Lightmap& light,
                                std::span<const math::Rgb> emittance, std::uint32_t begin,
                                std::uint32_t end) {
  const atlas::TextureGroup& all = world.texels;
  for (std::uint32_t t = begin; t < end; ++t) {
    const float visible = light.validity[t];
    const bool hidden = visible < kHiddenShare;
    math::Rgb b = hidden ? math::Rgb{} : all.albedo[t] * light.irradiance(t) * (1 / visible);
    if (!emittance.empty()) b += emittance[t];
    const float area = all.area_m2[t];
    squares_[t] = {b.r, b.g, b.b, area > 0 ? all.coverage[t] / area : 0};
    seen_m2_[t] = hidden ? 0 : area * visible;
  }
}

RadiosityMips::Level RadiosityMips::first_level(const World& world) const {
  const atlas::TextureGroup& all = world.texels;
  Level level;
  level.places.resize(all.size());
  for (std::uint32_t t = 0; t < all.size(); ++t)
    level.places[t] = {t, 2 * all.chart[t] + all.is_back(t), all.page[t], all.x[t], all.y[t]};
  return level;
}

/// Joins the squares of a level, up to four at a time, and returns those that are not all of their
/// chart.
RadiosityMips::Level RadiosityMips::next_level(const World& world, const Level& fine) {
  Level coarse;
  coarse.shift = fine.shift + 1;
  const auto begin = std::uint32_t(squares_.size());
  // The first square in each place of a page, and for each square the next one, of another chart.
  std::vector<std::vector<std::uint32_t>> first(world.texels.pages.size());
  std::vector<std::uint32_t> next, of_chart(2 * world.atlas.charts.size());
  for (const Level::Place& part : fine.places) {
    const atlas::TextureGroup::Page& page = world.texels.pages[part.page];
    const std::uint32_t columns = (page.width >> coarse.shift) + 1;
    auto& places = first[part.page];
    if (places.empty())
      places.assign(std::size_t(columns) * ((page.height >> coarse.shift) + 1), kNone);
    const auto x = std::uint16_t(part.x / 2), y = std::uint16_t(part.y / 2);
    std::uint32_t& head = places[std::size_t(y) * columns + x];
    std::uint32_t i = head;
    while (i != kNone && coarse.places[i].chart != part.chart) i = next[i];
    if (i == kNone) {
      i = std::uint32_t(coarse.places.size());
      coarse.places.push_back({begin + i, part.chart, part.page, x, y});
      next.push_back(head), head = i;
      squares_.emplace_back(), seen_m2_.push_back(0), parent_.push_back(begin + i);
      ++of_chart[part.chart];
    }
    parent_[part.square] = begin + i;
    const float area = seen_m2_[part.square];
    const Square from = squares_[part.square];
    Square& to = squares_[begin + i];
    to.r += from.r * area, to.g += from.g * area, to.b += from.b * area;
    seen_m2_[begin + i] += area;
  }
  for (std::size_t s = begin; s < squares_.size(); ++s) {
    const float scale = seen_m2_[s] > 0 ? 1 / seen_m2_[s] : 0;
    squares_[s].r *= scale, squares_[s].g *= scale, squares_[s].b *= scale;
  }
  std::erase_if(coarse.places, [&](const Level::Place& p) { return of_chart[p.chart] == 1; });
  return coarse;
}

}  // namespace kiln::solver::directional
