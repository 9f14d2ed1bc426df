#include <cstddef>

#include "baker/output/post.h"

namespace kiln::output {
namespace {

constexpr std::uint32_t kEmpty = 0xFFFFFFFFu;    // no source yet
constexpr std::uint32_t kPending = 0xFFFFFFFEu;  // in the ring that is filled next

/// Finds for each texel of a page the lit texel whose value it shows, as a row-major index. Padding
/// grows in rings of 8-neighbors. A texel considers its neighbors' sources and keeps the nearest
/// one (Euclidean, the first in row order among equals), so a ring depends only on the ring before
/// it.
class Padding {
 public:
  explicit Padding(const atlas::TextureGroup::Page& page)
      : width_(page.width), height_(page.height), source_(page.texel_at.size(), kEmpty) {
    for (std::uint32_t i = 0; i < source_.size(); ++i)
      if (page.texel_at[i] >= 0) source_[i] = i;
    for (std::uint32_t y = 0; y < height_; ++y)
      for (std::uint32_t x = 0; x < width_; ++x)
        if (is_rim(x, y)) ring_.push_back(y * width_ + x);
  }

  /// Fills one ring. Returns false when there is nothing left to fill.
  bool grow() {
    std::vector<std::uint32_t> next = empty_neighbors();
    std::vector<std::uint32_t> chosen(next.size());
    for (std::size_t k = 0; k < next.size(); ++k) chosen[k] = nearest_source(next[k]);
    for (std::size_t k = 0; k < next.size(); ++k) source_[next[k]] = chosen[k];
    ring_ = std::move(next);
    return !ring_.empty();
  }

  const std::vector<std::uint32_t>& sources() const { return source_; }

 private:
  /// Returns whether the texel is lit and has an empty one beside it.
  bool is_rim(std::uint32_t x, std::uint32_t y) const {
    if (source_[std::size_t(y) * width_ + x] == kEmpty) return false;
    const std::uint32_t x0 = x - (x > 0), x1 = std::min(x + 1, width_ - 1);
    const std::uint32_t y1 = std::min(y + 1, height_ - 1);
    for (std::uint32_t ny = y - (y > 0); ny <= y1; ++ny) {
      const std::uint32_t* row = &source_[std::size_t(ny) * width_];
      if (row[x0] == kEmpty || row[x] == kEmpty || row[x1] == kEmpty) return true;
    }
    return false;
  }

  template <class Visit>
  void for_neighbors(std::uint32_t texel, Visit visit) const {
    const std::uint32_t x = texel % width_, y = texel / width_;
    const std::uint32_t x1 = std::min(x + 1, width_ - 1), y1 = std::min(y + 1, height_ - 1);
    for (std::uint32_t ny = y - (y > 0); ny <= y1; ++ny)
      for (std::uint32_t nx = x - (x > 0); nx <= x1; ++nx) visit(ny * width_ + nx);
  }

  std::vector<std::uint32_t> empty_neighbors() {
    std::vector<std::uint32_t> found;
    for (const std::uint32_t texel : ring_)
      for_neighbors(texel, [&](std::uint32_t n) {
        if (source_[n] != kEmpty) return;
        source_[n] = kPending;
        found.push_back(n);
      });
    return found;
  }

  std::uint64_t squared_distance(std::uint32_t a, std::uint32_t b) const {
    const std::int64_t dx = std::int64_t(a % width_) - b % width_;
    const std::int64_t dy = std::int64_t(a / width_) - b / width_;
    return std::uint64_t(dx * dx + dy * dy);
  }

  std::uint32_t nearest_source(std::uint32_t texel) const {
    std::uint32_t best = kEmpty;
    std::uint64_t best_distance = ~std::uint64_t{0};
    for_neighbors(texel, [&](std::uint32_t n) {
      const std::uint32_t s = source_[n];
      if (s == kEmpty || s == kPending) return;
      const std::uint64_t d = squared_distance(texel, s);
      if (d > best_distance || (d == best_distance && s >= best)) return;
      best = s;
      best_distance = d;
    });
    return best;
  }

  std::uint32_t width_, height_;
  std::vector<std::uint32_t> source_;
  std::vector<std::uint32_t> ring_;  // the texels filled last; at first, the rims of charts
};

}  // namespace

image::PageImage compose_page(const atlas::TextureGroup& group, std::uint32_t page_index,
                              const TexelValue& value, std::uint32_t dilate) {
  const atlas::TextureGroup::Page& page = group.pages.at(page_index);
  Padding padding(page);
  for (std::uint32_t ring = 0; dilate == 0 || ring < dilate; ++ring)
    if (!padding.grow()) break;

  image::PageImage image{page.width, page.height, {}, {}};
  image.rgb.resize(page.texel_at.size());
  image.coverage.resize(page.texel_at.size());
  for (std::size_t i = 0; i < image.rgb.size(); ++i) {
    const std::uint32_t source = padding.sources()[i];
    if (source != kEmpty) image.rgb[i] = value(std::uint32_t(page.texel_at[source]));
    if (page.texel_at[i] >= 0) image.coverage[i] = group.coverage[page.texel_at[i]];
  }
  return image;
}

}  // namespace kiln::output
