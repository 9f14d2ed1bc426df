#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "baker/image/page_image.h"

namespace kiln::output {

/// A page of the reference a, and the same page of what is compared with it, x. All images are of
/// one size.
struct PagePair {
  const image::PageImage& reference;
  const image::PageImage& candidate;
  /// Another reference c of the same light, whose noise is independent of a's; may be null.
  const image::PageImage* second = nullptr;
};

/// The luminance of the absolute differences of the channels, linear [Moos eq. 5.1].
double luminance_difference(math::Rgb a, math::Rgb b);

/// Counts of texels by their luminance, 0 to 255; what is brighter is in the last bin.
using Histogram = std::array<std::uint64_t, 64>;

/// Error figures between two images. Unless it says otherwise, a figure covers the three channels
/// of all texels that are lit (coverage > 0) in both; a = reference, x = candidate, d = x - a.
/// Values on the scale of 0 to 255 are 255 v / scale, not less than 0 and not more than 255.
struct CompareResult {
  std::uint64_t texels = 0;     ///< lit in both
  std::uint64_t pixels = 0;     ///< of the pages, lit or not
  std::uint64_t uncovered = 0;  ///< lit in the reference only
  std::uint64_t nonfinite = 0;  ///< candidate texels with a NaN or an infinity: such a channel is 0
  double mean_reference = 0;    ///< mean a
  double rmse = 0;              ///< sqrt(mean d^2)
  double nrmse = 0;             ///< rmse / mean a; 0 where mean a is 0
  double rel_rmse = 0;          ///< sqrt(mean (d / (a + 0.02 mean a))^2): weights dark texels
  double bias = 0;              ///< mean d / mean a; 0 where mean a is 0
  double max_abs = 0;           ///< max |d|
  double dfpr = 0;              ///< mean Euclidean RGB distance per texel, in the images' unit
  double scale = 1;             ///< the value that counts as 1
  double dfpr_lit = 0;          ///< mean Euclidean distance of RGB / scale, clamped to 0..1
  double dfpr_all = 0;          ///< the same over all pixels, padding too [RTRad eq. 6.1]
  /// Shares of the texels whose luminance_difference() is more than kLevels of 255
  /// [Moreno-Fortuny 5.1.3].
  static constexpr std::array<int, 3> kLevels{10, 25, 40};
  std::array<double, 3> beyond{};
  Histogram reference_histogram{}, candidate_histogram{};  ///< of luminance
  /// With a second reference, over texels that are lit in all three.
  struct Unbiased {
    double mse = 0;    ///< mean (x - a)(x - c): the noise of a and c is in it on average no more
    double nrmse = 0;  ///< sqrt(mse) / mean a; 0 where mse is below 0
    double noise = 0;  ///< sqrt(mean (a - c)^2 / 2) / mean a: the noise of one reference
  };
  std::optional<Unbiased> unbiased;
};

/// Measures pages, which it sees twice: look_at() once for each page, then add() for each, in the
/// same order. Sums are in double precision, in the order of the rows.
class Comparison {
 public:
  /// @param scale the value that counts as 1; null: the reference's largest lit channel
  explicit Comparison(std::optional<double> scale = {}) : scale_(scale) {}

  void look_at(const PagePair&);
  /// The scale as far as pages were looked at. A black reference has 1.
  double scale() const;
  void add(const PagePair&);
  CompareResult result() const;

 private:
  double mean() const;
  void add_texel(math::Rgb a, math::Rgb x);

  std::optional<double> scale_;
  double sum_ = 0, largest_ = 0;                                       ///< of what was looked at
  std::uint64_t lit_ = 0;                                              ///< the same
  double squares_ = 0, weighted_ = 0, difference_ = 0, distance_ = 0;  ///< of what was added
  double scaled_lit_ = 0, scaled_all_ = 0;
  double products_ = 0, noise_ = 0;
  std::uint64_t thrice_lit_ = 0;
  std::array<std::uint64_t, 3> beyond_{};
  bool has_second_ = false;
  CompareResult out_;
};

/// Compares two images. It throws when the sizes differ, which is a bug of the caller.
CompareResult compare(const image::PageImage& reference, const image::PageImage& candidate,
                      std::optional<double> scale = {}, const image::PageImage* second = nullptr);

/// All figures by their names; `unbiased` is there with a second reference only.
nlohmann::json to_json(const CompareResult&);
/// The histograms as text/csv: columns from, to, reference, candidate; a row for each bin.
std::string histogram_csv(const CompareResult&);

}  // namespace kiln::output
