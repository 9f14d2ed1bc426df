#include "baker/atlas/band_sweep.h"

namespace kiln::atlas {
namespace {

std::uint32_t band_of(double y, std::uint32_t bands) {
  return std::uint32_t(std::clamp(std::floor(y / kBlock), 0.0, double(bands - 1)));
}

std::uint32_t key_of(int x, int y) {
  return std::uint32_t(x >> 3 << 6 | (y & 7) << 3 | (x & 7));
}

}  // namespace

BandSweep::BandSweep(const Atlas& atlas, std::size_t max_fragments, std::stop_token stop)
    : atlas_(atlas),
      stopped_(std::move(stop)),
      max_fragments_(max_fragments),
      bands_((atlas.page_size + kBlock - 1) / kBlock) {
  constexpr std::uint32_t kFlat = 0xffffffffu;
  const auto count = std::uint32_t(atlas.triangles.size());
  first_.assign(std::size_t(atlas.page_count) * bands_ + 1, 0);
  const auto step_of = [&](std::uint32_t t) {
    const UvTriangle uv(atlas, t);
    if (!(uv.area() >= kMinUvArea)) return kFlat;
    const double top = std::min({uv.p[0].y, uv.p[1].y, uv.p[2].y});
    return atlas.page_of(t) * bands_ + band_of(top, bands_);
  };
  for (std::uint32_t t = 0; t < count; ++t) {
    if (stopped_()) return;
    const std::uint32_t step = step_of(t);
    if (step == kFlat) {
      flat_.push_back(t);
    } else {
      ++first_[step + 1];
    }
  }
  for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  order_.resize(count - flat_.size());
  std::vector<std::uint32_t> at(first_.begin(), first_.end() - 1);
  for (std::uint32_t t = 0; t < count; ++t) {
    if (stopped_()) return;
    if (const std::uint32_t step = step_of(t); step != kFlat) order_[at[step]++] = t;
  }
}

bool BandSweep::next() {
  page_ = step_ / bands_;
  band_ = step_ % bands_;
  if (band_ == 0) active_.clear();
  start_triangles();
  ++step_;
  if (!cut_active()) return false;
  sort_by_texel();
  return true;
}

void BandSweep::start_triangles() {
  active_.insert(active_.end(), order_.begin() + first_[step_], order_.begin() + first_[step_ + 1]);
}

bool BandSweep::cut_active() {
  const int y0 = int(band_ * kBlock);
  const int y1 = int(std::min(band_ * kBlock + kBlock, atlas_.page_size));
  fragments_.clear();
  std::size_t kept = 0;
  for (const std::uint32_t t : active_) {
    const UvTriangle uv(atlas_, t);
    for_texels(uv.polygon(), y0, y1, int(atlas_.page_size), [&](int x, int y, double area) {
      fragments_.push_back({key_of(x, y), t, area});
    });
    if (fragments_.size() > max_fragments_ || stopped_()) return false;
    if (std::max({uv.p[0].y, uv.p[1].y, uv.p[2].y}) > y1) active_[kept++] = t;
  }
  active_.resize(kept);
  return true;
}

void BandSweep::sort_by_texel() {
  const std::uint32_t keys = (atlas_.page_size + kBlock - 1) / kBlock * kBlock * kBlock;
  offsets_.assign(std::size_t(keys) + 1, 0);
  for (const Fragment& f : fragments_) ++offsets_[f.key + 1];
  for (std::size_t i = 1; i < offsets_.size(); ++i) offsets_[i] += offsets_[i - 1];
  sorted_.resize(fragments_.size());
  for (const Fragment& f : fragments_) sorted_[offsets_[f.key]++] = f;
}

}  // namespace kiln::atlas
