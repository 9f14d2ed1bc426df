#include "baker/solver/pairwise/windows.h"

#include <algorithm>
#include <utility>

namespace kiln::solver::pairwise {
namespace {

constexpr std::uint32_t kNoWindow = 0xffffffff;
/// Texels, or windows, between two looks at the stop token.
constexpr std::uint32_t kLook = 1u << 16;

}  // namespace

Windows::Windows(const atlas::TextureGroup& texels, std::uint32_t side,
                 const std::stop_token& stop) {
  const auto stopped = [&](std::uint32_t i) { return i % kLook == 0 && stop.stop_requested(); };
  const auto across = [&](std::uint32_t length) { return (length + side - 1) / side; };
  std::vector<std::size_t> first_place;  // of each page
  std::size_t places = 0;
  for (const atlas::TextureGroup::Page& page : texels.pages) {
    first_place.push_back(places);
    places += std::size_t(2) * across(page.width) * across(page.height);
  }
  const auto place_of = [&](std::uint32_t t) {
    const atlas::TextureGroup::Page& page = texels.pages[texels.page[t]];
    const std::uint32_t row = texels.y[t] / side, column = texels.x[t] / side;
    const std::size_t square = std::size_t(row) * across(page.width) + column;
    return first_place[texels.page[t]] + 2 * square + texels.is_back(t);
  };

  std::vector<std::uint32_t> window_at(places, kNoWindow);
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    if (stopped(t)) return;
    std::uint32_t& window = window_at[place_of(t)];
    if (window == kNoWindow) {
      window = size();
      places_.push_back(std::uint32_t(place_of(t)));
      starts_.push_back(0);
    }
    ++starts_[window];
  }
  std::uint32_t start = 0;
  for (std::uint32_t& s : starts_) start += std::exchange(s, start);
  starts_.push_back(start);

  order_.resize(texels.size());
  std::vector<std::uint32_t> next(starts_);
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    if (stopped(t)) return;
    order_[next[window_at[place_of(t)]]++] = t;
  }
  area_up_to_.reserve(order_.size());
  for (std::uint32_t w = 0; w < size(); ++w) {
    if (stopped(w)) return;
    double area = 0;
    for (const std::uint32_t t : this->texels(w))
      area_up_to_.push_back(float(area += double(texels.area_m2[t])));
  }
}

std::uint32_t Windows::texel_at(std::uint32_t window, float u) const {
  const auto begin = area_up_to_.begin() + starts_[window],
             end = area_up_to_.begin() + starts_[window + 1];
  const auto at = std::upper_bound(begin, end - 1, u * area_m2(window));
  return order_[std::size_t(at - area_up_to_.begin())];
}

}  // namespace kiln::solver::pairwise
