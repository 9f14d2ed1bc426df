#include "baker/atlas/layout.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <optional>
#include <string>

#include "baker/atlas/pack.h"
#include "baker/exec/stop.h"

namespace kiln::atlas {
namespace {

struct Group {
  std::uint32_t first = 0, count = 0;  ///< blocks
  std::uint64_t area = 0;              ///< texels^2 with gutters, at the density under trial
};

class Packer {
 public:
  Packer(std::span<const Block> blocks, const proto::AtlasSettings& settings, std::stop_token stop)
      : blocks_(blocks), gutter_(settings.gutter), stop_(std::move(stop)) {
    // Each block carries the gutter above it and to its left. The page's edge carries the last
    // gutter below and to the right.
    side_ = settings.page_size > gutter_ ? settings.page_size - gutter_ : 0;
    for (std::uint32_t i = 0; i < blocks.size(); ++i) {
      if (i == 0 || blocks[i].group != blocks[i - 1].group) groups_.push_back({i, 0, 0});
      ++groups_.back().count;
      longest_ = std::max({longest_, blocks[i].width, blocks[i].height});
    }
    places_.resize(blocks.size());
  }

  /// Returns a density at which every block has one texel.
  double least_density() const { return 0.5 / longest_; }

  /// Sizes the blocks and returns whether their areas alone could fit `pages`. This check is cheap.
  bool room_for(double density, std::uint32_t pages) {
    std::uint64_t total = 0;
    for (Group& group : groups_) {
      group.area = 0;
      for (std::uint32_t i = group.first; i < group.first + group.count; ++i) {
        if (!size_block(i, density)) return false;
        group.area += std::uint64_t(places_[i].width + gutter_) * (places_[i].height + gutter_);
      }
      if (group.area > page_area()) return false;
      total += group.area;
    }
    return total <= page_area() * pages;
  }

  /// Packs all blocks. Returns nothing when they do not fit, or when stopped.
  std::optional<Layout> pack(double density, std::uint32_t pages) {
    if (!room_for(density, pages)) return std::nullopt;
    std::vector<Group> order = groups_;
    std::stable_sort(order.begin(), order.end(),
                     [](const Group& a, const Group& b) { return a.area > b.area; });
    std::uint32_t page = 0;
    for (std::size_t begin = 0; begin < order.size(); ++page) {
      if (page == pages || stop_.stop_requested()) return std::nullopt;
      const std::size_t taken = fill_page(std::span(order).subspan(begin), page, page + 1 == pages);
      if (taken == 0) return std::nullopt;
      begin += taken;
    }
    return Layout{density, page, places_};
  }

  /// Finds the highest density that fits, between one that is known to fit and room_for()'s limit.
  std::optional<Layout> densest(std::uint32_t pages) {
    std::optional<Layout> best = pack(least_density(), pages);
    if (!best) return best;
    double fits = least_density(), limit = double(side_) / longest_;
    for (int i = 0; i < 48 && limit > fits * 1.0001; ++i) {
      const double middle = std::sqrt(fits * limit);
      (room_for(middle, pages) ? fits : limit) = middle;
    }
    fits = best->texels_per_metre;
    for (double d = limit; d > fits;) {  // packing wastes some room: step down until it fits
      d *= 0.92;
      if (stop_.stop_requested()) return best;
      auto layout = pack(d, pages);
      if (!layout) {
        limit = d;
        continue;
      }
      best = std::move(layout);
      break;
    }
    for (int i = 0; i < 6 && !stop_.stop_requested(); ++i) {
      const double middle = std::sqrt(best->texels_per_metre * limit);
      auto layout = pack(middle, pages);
      if (layout) {
        best = std::move(layout);
      } else {
        limit = middle;
      }
    }
    return best;
  }

  std::size_t block_count() const { return blocks_.size(); }

 private:
  std::uint64_t page_area() const { return std::uint64_t(side_) * side_; }

  bool size_block(std::uint32_t i, double density) {
    const double w = std::ceil(blocks_[i].width * density - 1e-6);
    const double h = std::ceil(blocks_[i].height * density - 1e-6);
    if (!(std::max(w, h) + gutter_ <= side_)) return false;
    places_[i].width = std::uint32_t(std::max(w, 1.0));
    places_[i].height = std::uint32_t(std::max(h, 1.0));
    return places_[i].width + gutter_ <= side_ && places_[i].height + gutter_ <= side_;
  }

  /// Places the longest run of groups from the front that fits on one page, and returns its length.
  /// On the last page the run must hold all groups.
  std::size_t fill_page(std::span<const Group> groups, std::uint32_t page, bool last) {
    std::size_t most = 0;
    for (std::uint64_t area = 0; most < groups.size(); ++most) {
      area += groups[most].area;
      if (area > page_area()) break;
    }
    if (last) return most == groups.size() && try_page(groups, page) ? most : 0;
    if (try_page(groups.first(most), page)) return most;
    std::size_t fits = 0;
    while (fits + 1 < most && !stop_.stop_requested()) {
      const std::size_t middle = fits + (most - fits) / 2;
      (try_page(groups.first(middle), page) ? fits : most) = middle;
    }
    return fits > 0 && try_page(groups.first(fits), page) ? fits : 0;
  }

  bool try_page(std::span<const Group> groups, std::uint32_t page) {
    rects_.clear();
    for (const Group& group : groups) {
      for (std::uint32_t i = group.first; i < group.first + group.count; ++i) {
        rects_.push_back({places_[i].width + gutter_, places_[i].height + gutter_});
      }
    }
    if (!pack_square(rects_, side_, stop_)) return false;
    std::size_t next = 0;
    for (const Group& group : groups) {
      for (std::uint32_t i = group.first; i < group.first + group.count; ++i, ++next) {
        places_[i].page = page;
        places_[i].x = rects_[next].x + gutter_;
        places_[i].y = rects_[next].y + gutter_;
      }
    }
    return true;
  }

  std::span<const Block> blocks_;
  std::uint32_t gutter_ = 0, side_ = 0;
  std::stop_token stop_;
  double longest_ = 1e-30;  ///< m, longest side of a block
  std::vector<Group> groups_;
  std::vector<Place> places_;
  std::vector<PackRect> rects_;
};

std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", v);
  return text;
}

std::string pages_text(const proto::AtlasSettings& s) {
  const std::string side = std::to_string(s.page_size);
  return std::to_string(s.max_pages) + (s.max_pages == 1 ? " page" : " pages") + " of " + side +
         " x " + side + " texels";
}

proto::Unexpected too_many_blocks(const Packer& packer, const proto::AtlasSettings& s) {
  return proto::fail("atlas_full",
                     std::to_string(packer.block_count()) + " charts with a gutter of " +
                         std::to_string(s.gutter) + " do not fit " + pages_text(s) +
                         ", even at one texel each",
                     "settings", "/atlas/page_size");
}

}  // namespace

proto::Expected<Layout> lay_out_blocks(std::span<const Block> blocks,
                                       const proto::AtlasSettings& settings, std::stop_token stop) {
  Packer packer(blocks, settings, stop);
  std::optional<Layout> layout;
  if (settings.texels_per_metre) {
    layout = packer.pack(double(*settings.texels_per_metre), settings.max_pages);
    if (!layout && !stop.stop_requested()) {
      const auto possible = packer.densest(settings.max_pages);
      if (stop.stop_requested()) return exec::canceled();
      if (!possible) return too_many_blocks(packer, settings);
      return proto::fail("atlas_full",
                         number(double(*settings.texels_per_metre)) +
                             " texels per meter do not fit " + pages_text(settings) + "; " +
                             number(std::floor(possible->texels_per_metre * 1000) / 1000) +
                             " would",
                         "settings", "/atlas/texels_per_metre");
    }
  } else {
    for (std::uint32_t pages = 1; pages <= settings.max_pages && !layout; ++pages) {
      layout = packer.densest(pages);
    }
  }
  if (stop.stop_requested()) return exec::canceled();
  if (!layout) return too_many_blocks(packer, settings);
  return std::move(*layout);
}

LayoutAdvice find_layout_advice(std::span<const Block> blocks, const proto::AtlasSettings& settings,
                                std::stop_token stop) {
  const auto packed = [&](const proto::AtlasSettings& tried) {
    Packer packer(blocks, tried, stop);
    const auto wanted = tried.texels_per_metre;
    return packer.pack(wanted ? double(*wanted) : packer.least_density(), tried.max_pages);
  };
  LayoutAdvice advice;
  proto::AtlasSettings more = settings;
  more.max_pages = proto::AtlasSettings::kMostPages;
  if (const auto layout = packed(more)) advice.max_pages = layout->pages;
  proto::AtlasSettings larger = settings;
  larger.page_size = std::bit_ceil(settings.page_size + 1);
  for (; larger.page_size <= proto::AtlasSettings::kMostPageSize; larger.page_size *= 2) {
    if (!packed(larger)) continue;
    advice.page_size = larger.page_size;
    break;
  }
  return advice;
}

}  // namespace kiln::atlas
