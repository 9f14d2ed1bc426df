#include <cmath>
#include <stdexcept>

#include "baker/output/post.h"

namespace kiln::output {
namespace {

/// The share of the mean below which relRMSE stops giving dark texels more weight.
constexpr double kDarkFloor = 0.02;

bool both_lit(const image::PageImage& a, const image::PageImage& b, std::size_t i) {
  return a.coverage[i] > 0 && b.coverage[i] > 0;
}

double reference_mean(const image::PageImage& reference, const image::PageImage& candidate,
                      std::uint64_t& texels) {
  double sum = 0;
  texels = 0;
  for (std::size_t i = 0; i < reference.rgb.size(); ++i) {
    if (!both_lit(reference, candidate, i)) continue;
    const math::Rgb r = reference.rgb[i];
    sum += double(r.r) + double(r.g) + double(r.b);
    ++texels;
  }
  return texels ? sum / double(3 * texels) : 0;
}

}  // namespace

CompareResult compare(const image::PageImage& reference, const image::PageImage& candidate) {
  if (reference.width != candidate.width || reference.height != candidate.height)
    throw std::invalid_argument("compare: images of different sizes");
  CompareResult out;
  out.mean_reference = reference_mean(reference, candidate, out.texels);
  double squares = 0, weighted = 0, difference = 0, distance = 0;
  for (std::size_t i = 0; i < reference.rgb.size(); ++i) {
    out.uncovered += reference.coverage[i] > 0 && !(candidate.coverage[i] > 0);
    if (!both_lit(reference, candidate, i)) continue;
    const math::Rgb r = reference.rgb[i];
    math::Rgb c = candidate.rgb[i];
    if (!std::isfinite(c.r) || !std::isfinite(c.g) || !std::isfinite(c.b)) {
      ++out.nonfinite;
      c = {std::isfinite(c.r) ? c.r : 0, std::isfinite(c.g) ? c.g : 0,
           std::isfinite(c.b) ? c.b : 0};
    }
    double texel = 0;
    for (const auto& [rv, cv] : {std::pair{r.r, c.r}, {r.g, c.g}, {r.b, c.b}}) {
      const double d = double(cv) - double(rv);
      const double relative = d / (double(rv) + kDarkFloor * out.mean_reference);
      texel += d * d;
      if (d != 0) weighted += relative * relative;
      difference += d;
      out.max_abs = std::max(out.max_abs, std::abs(d));
    }
    squares += texel;
    distance += std::sqrt(texel);
  }
  if (out.texels == 0) return out;
  const double values = double(3 * out.texels);
  out.rmse = std::sqrt(squares / values);
  out.rel_rmse = std::sqrt(weighted / values);
  out.dfpr = distance / double(out.texels);
  if (out.mean_reference > 0) {
    out.nrmse = out.rmse / out.mean_reference;
    out.bias = difference / values / out.mean_reference;
  }
  return out;
}

}  // namespace kiln::output
