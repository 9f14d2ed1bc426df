#include "baker/output/error_map.h"

#include <algorithm>
#include <cmath>

namespace kiln::output {
namespace {

using math::Rgb;

/// Stops at even steps; their luminance grows by about as much from each to the next.
constexpr std::array<Color, 6> kEmber{
    {{0, 0, 0}, {62, 22, 110}, {168, 34, 92}, {228, 92, 42}, {250, 172, 60}, {255, 255, 255}}};

/// The longer side of contours() is at least half of this.
constexpr std::uint32_t kContourSide = 1024;

/// The luminance of an image between the centers of its texels.
class Interpolated {
 public:
  Interpolated(const image::PageImage& image, std::uint32_t zoom) : image_(image), zoom_(zoom) {}

  bool lit(std::uint32_t x, std::uint32_t y) const { return covered(x / zoom_, y / zoom_); }

  /// The place must be lit. Texels that are not count for nothing.
  double at(std::uint32_t x, std::uint32_t y) const {
    const double u = place(x, image_.width), v = place(y, image_.height);
    const auto x0 = std::uint32_t(u), y0 = std::uint32_t(v);
    const std::uint32_t x1 = std::min(x0 + 1, image_.width - 1),
                        y1 = std::min(y0 + 1, image_.height - 1);
    const double fx = u - x0, fy = v - y0;
    double sum = 0, weights = 0;
    for (const auto& [tx, wx] : {std::pair{x0, 1 - fx}, {x1, fx}})
      for (const auto& [ty, wy] : {std::pair{y0, 1 - fy}, {y1, fy}}) {
        if (!covered(tx, ty)) continue;
        sum += wx * wy * double(luminance(image_.rgb[std::size_t(ty) * image_.width + tx]));
        weights += wx * wy;
      }
    return weights > 0 ? sum / weights : 0;
  }

 private:
  double place(std::uint32_t at, std::uint32_t size) const {
    return std::clamp((at + 0.5) / zoom_ - 0.5, 0.0, double(size - 1));
  }
  bool covered(std::uint32_t x, std::uint32_t y) const {
    return image_.coverage[std::size_t(y) * image_.width + x] > 0;
  }

  const image::PageImage& image_;
  std::uint32_t zoom_;
};

/// For each pixel of a row, the number of levels that its luminance has reached; -1: not lit.
std::vector<int> bands(const Interpolated& image, std::uint32_t width, std::uint32_t y,
                       double scale) {
  std::vector<int> row(width, -1);
  for (std::uint32_t x = 0; x < width; ++x) {
    if (!image.lit(x, y)) continue;
    const double value = 255 * image.at(x, y) / scale;
    row[x] = int(std::count_if(kContourLevels.begin(), kContourLevels.end(),
                               [&](int level) { return value >= level; }));
  }
  return row;
}

/// Whether a level lies between a pixel and the next to the right, or below.
std::vector<bool> lines(const std::vector<int>& row, const std::vector<int>& below) {
  std::vector<bool> out(row.size());
  const auto between = [](int a, int b) { return a >= 0 && b >= 0 && a != b; };
  for (std::size_t x = 0; x < row.size(); ++x)
    out[x] = between(row[x], below[x]) || (x + 1 < row.size() && between(row[x], row[x + 1]));
  return out;
}

}  // namespace

Color ember(double share) {
  if (!(share < 1)) return kEmber.back();
  const double at = std::max(share, 0.0) * double(kEmber.size() - 1);
  const auto below = std::size_t(at);
  Color out;
  for (std::size_t c = 0; c < out.size(); ++c)
    out[c] = std::uint8_t(std::lround(
        std::lerp(double(kEmber[below][c]), double(kEmber[below + 1][c]), at - double(below))));
  return out;
}

Picture error_map(const PagePair& pages, double full) {
  const image::PageImage& a = pages.reference;
  Picture out{a.width, a.height, {}};
  out.pixels.assign(a.rgb.size(), kNothing);
  for (std::size_t i = 0; i < a.rgb.size(); ++i)
    if (a.coverage[i] > 0 && pages.candidate.coverage[i] > 0)
      out.pixels[i] = ember(luminance_difference(a.rgb[i], pages.candidate.rgb[i]) / full);
  return out;
}

Picture contours(const PagePair& pages, double scale) {
  const image::PageImage& a = pages.reference;
  const std::uint32_t zoom = std::max(1u, kContourSide / std::max({1u, a.width, a.height}));
  Picture out{a.width * zoom, a.height * zoom, {}};
  out.pixels.reserve(std::size_t(out.width) * out.height);
  const std::array images{Interpolated(a, zoom), Interpolated(pages.candidate, zoom)};
  std::array<std::vector<int>, 2> rows, below;
  for (int i = 0; i < 2; ++i) below[i] = bands(images[i], out.width, 0, scale);
  for (std::uint32_t y = 0; y < out.height; ++y) {
    rows = std::move(below);
    const std::uint32_t next = std::min(y + 1, out.height - 1);
    for (int i = 0; i < 2; ++i) below[i] = bands(images[i], out.width, next, scale);
    const std::vector<bool> reference = lines(rows[0], below[0]),
                            candidate = lines(rows[1], below[1]);
    for (std::uint32_t x = 0; x < out.width; ++x) {
      Color color = kNothing;
      if (rows[0][x] >= 0) {
        const double share = std::clamp(images[0].at(x, y) / scale, 0.0, 1.0);
        color.fill(std::uint8_t(96 * std::sqrt(share)));
      }
      if (reference[x])
        color = candidate[x] ? kCommonLine : kReferenceLine;
      else if (candidate[x])
        color = kCandidateLine;
      out.pixels.push_back(color);
    }
  }
  return out;
}

}  // namespace kiln::output
