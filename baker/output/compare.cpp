#include "baker/output/compare.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace kiln::output {
namespace {

using math::Rgb;

/// The share of the mean below which relRMSE stops giving dark texels more weight.
constexpr double kDarkFloor = 0.02;

bool is_finite(Rgb v) {
  return std::isfinite(v.r) && std::isfinite(v.g) && std::isfinite(v.b);
}
Rgb finite_channels(Rgb v) {
  return {std::isfinite(v.r) ? v.r : 0, std::isfinite(v.g) ? v.g : 0, std::isfinite(v.b) ? v.b : 0};
}

/// Returns v / scale within 0..1. A NaN becomes 0.
double shown(double v, double scale) {
  v /= scale;
  return v > 0 ? std::min(v, 1.0) : 0;
}
Rgb shown(Rgb v, double scale) {
  return {float(shown(double(v.r), scale)), float(shown(double(v.g), scale)),
          float(shown(double(v.b), scale))};
}

double distance(Rgb a, Rgb b) {
  const double r = double(a.r) - double(b.r), g = double(a.g) - double(b.g),
               blue = double(a.b) - double(b.b);
  return std::sqrt(r * r + g * g + blue * blue);
}

void count(Histogram& bins, Rgb v, double scale) {
  const double y = shown(double(luminance(v)), scale);
  ++bins[std::min(std::size_t(y * double(bins.size())), bins.size() - 1)];
}

void check_sizes(const PagePair& pages) {
  const auto same = [&](const image::PageImage& image) {
    return image.width == pages.reference.width && image.height == pages.reference.height;
  };
  if (!same(pages.candidate) || (pages.second && !same(*pages.second)))
    throw std::invalid_argument("compare: images of different sizes");
}

bool both_lit(const PagePair& pages, std::size_t i) {
  return pages.reference.coverage[i] > 0 && pages.candidate.coverage[i] > 0;
}

}  // namespace

double luminance_difference(Rgb a, Rgb b) {
  return 0.2126 * std::abs(double(a.r) - double(b.r)) +
         0.7152 * std::abs(double(a.g) - double(b.g)) +
         0.0722 * std::abs(double(a.b) - double(b.b));
}

void Comparison::look_at(const PagePair& pages) {
  check_sizes(pages);
  for (std::size_t i = 0; i < pages.reference.rgb.size(); ++i) {
    if (!both_lit(pages, i)) continue;
    const Rgb a = pages.reference.rgb[i];
    sum_ += double(a.r) + double(a.g) + double(a.b);
    largest_ = std::max(largest_, double(max_channel(finite_channels(a))));
    ++lit_;
  }
}

double Comparison::scale() const {
  if (scale_) return *scale_;
  return largest_ > 0 ? largest_ : 1;
}

double Comparison::mean() const {
  return lit_ ? sum_ / double(3 * lit_) : 0;
}

void Comparison::add_texel(Rgb a, Rgb x) {
  double texel = 0;
  for (const auto& [av, xv] : {std::pair{a.r, x.r}, {a.g, x.g}, {a.b, x.b}}) {
    const double d = double(xv) - double(av);
    const double relative = d / (double(av) + kDarkFloor * mean());
    texel += d * d;
    if (d != 0) weighted_ += relative * relative;
    difference_ += d;
    out_.max_abs = std::max(out_.max_abs, std::abs(d));
  }
  squares_ += texel;
  distance_ += std::sqrt(texel);
  const Rgb shown_a = shown(a, scale()), shown_x = shown(x, scale());
  scaled_lit_ += distance(shown_a, shown_x);
  const double difference = 255 * luminance_difference(shown_a, shown_x);
  for (std::size_t l = 0; l < beyond_.size(); ++l)
    beyond_[l] += difference > CompareResult::kLevels[l];
  count(out_.reference_histogram, a, scale());
  count(out_.candidate_histogram, x, scale());
}

void Comparison::add(const PagePair& pages) {
  check_sizes(pages);
  out_.pixels += pages.reference.rgb.size();
  has_second_ = has_second_ || pages.second;
  for (std::size_t i = 0; i < pages.reference.rgb.size(); ++i) {
    const Rgb a = pages.reference.rgb[i], x = finite_channels(pages.candidate.rgb[i]);
    scaled_all_ += distance(shown(a, scale()), shown(x, scale()));
    out_.uncovered += pages.reference.coverage[i] > 0 && !(pages.candidate.coverage[i] > 0);
    if (!both_lit(pages, i)) continue;
    ++out_.texels;
    out_.nonfinite += !is_finite(pages.candidate.rgb[i]);
    add_texel(a, x);
    if (!pages.second || !(pages.second->coverage[i] > 0)) continue;
    ++thrice_lit_;
    const Rgb c = pages.second->rgb[i];
    for (const auto& [av, xv, cv] : {std::array{a.r, x.r, c.r}, {a.g, x.g, c.g}, {a.b, x.b, c.b}}) {
      products_ += (double(xv) - double(av)) * (double(xv) - double(cv));
      noise_ += (double(av) - double(cv)) * (double(av) - double(cv)) / 2;
    }
  }
}

CompareResult Comparison::result() const {
  CompareResult out = out_;
  out.scale = scale();
  out.mean_reference = mean();
  if (out.pixels > 0) out.dfpr_all = scaled_all_ / double(out.pixels);
  if (has_second_) out.unbiased.emplace();
  if (out.texels == 0) return out;
  const double values = double(3 * out.texels);
  out.rmse = std::sqrt(squares_ / values);
  out.rel_rmse = std::sqrt(weighted_ / values);
  out.dfpr = distance_ / double(out.texels);
  out.dfpr_lit = scaled_lit_ / double(out.texels);
  for (std::size_t l = 0; l < beyond_.size(); ++l)
    out.beyond[l] = double(beyond_[l]) / double(out.texels);
  if (thrice_lit_ > 0) out.unbiased->mse = products_ / double(3 * thrice_lit_);
  if (out.mean_reference > 0) {
    out.nrmse = out.rmse / out.mean_reference;
    out.bias = difference_ / values / out.mean_reference;
    if (thrice_lit_ > 0) {
      out.unbiased->nrmse = std::sqrt(std::max(0.0, out.unbiased->mse)) / out.mean_reference;
      out.unbiased->noise = std::sqrt(noise_ / double(3 * thrice_lit_)) / out.mean_reference;
    }
  }
  return out;
}

CompareResult compare(const image::PageImage& reference, const image::PageImage& candidate,
                      std::optional<double> scale, const image::PageImage* second) {
  const PagePair pages{reference, candidate, second};
  Comparison comparison(scale);
  comparison.look_at(pages);
  comparison.add(pages);
  return comparison.result();
}

nlohmann::json to_json(const CompareResult& r) {
  nlohmann::json beyond = nlohmann::json::object();
  for (std::size_t l = 0; l < r.beyond.size(); ++l)
    beyond[std::to_string(CompareResult::kLevels[l])] = r.beyond[l];
  nlohmann::json out{
      {"texels", r.texels},
      {"pixels", r.pixels},
      {"uncovered", r.uncovered},
      {"nonfinite", r.nonfinite},
      {"mean_reference", r.mean_reference},
      {"rmse", r.rmse},
      {"nrmse", r.nrmse},
      {"rel_rmse", r.rel_rmse},
      {"bias", r.bias},
      {"max_abs", r.max_abs},
      {"dfpr", r.dfpr},
      {"scale", r.scale},
      {"dfpr_lit", r.dfpr_lit},
      {"dfpr_all", r.dfpr_all},
      {"beyond", std::move(beyond)},
      {"histogram", {{"reference", r.reference_histogram}, {"candidate", r.candidate_histogram}}}};
  if (r.unbiased)
    out["unbiased"] = {
        {"mse", r.unbiased->mse}, {"nrmse", r.unbiased->nrmse}, {"noise", r.unbiased->noise}};
  return out;
}

std::string histogram_csv(const CompareResult& r) {
  std::string out = "from,to,reference,candidate\n";
  const std::size_t bins = r.reference_histogram.size();
  for (std::size_t b = 0; b < bins; ++b) {
    char row[96];
    std::snprintf(row, sizeof row, "%.6g,%.6g,%llu,%llu\n", 255.0 * double(b) / double(bins),
                  255.0 * double(b + 1) / double(bins),
                  static_cast<unsigned long long>(r.reference_histogram[b]),
                  static_cast<unsigned long long>(r.candidate_histogram[b]));
    out += row;
  }
  return out;
}

}  // namespace kiln::output
