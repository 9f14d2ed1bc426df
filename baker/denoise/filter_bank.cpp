#include "baker/denoise/filter_bank.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace kiln::denoise {
namespace {

constexpr std::uint32_t kRunTexels = 2048;
constexpr int kCount = SurfaceNeighbors::kCount;

/// The color of the light, red, green, blue, and the sky's: its luminance, or if that is not
/// enough its own red, green, blue.
template <std::size_t kChannels>
struct alignas(16) Color {
  float c[kChannels];

  Color& add(float weight, const Color& o) {
    for (std::size_t i = 0; i < kChannels; ++i) c[i] += weight * o.c[i];
    return *this;
  }
};
using PlainColor = Color<4>;
using SkyColor = Color<6>;

float all_light(const PlainColor& l) {
  return math::luminance({l.c[0], l.c[1], l.c[2]}) + l.c[3];
}
float all_light(const SkyColor& l) {
  return math::luminance({l.c[0], l.c[1], l.c[2]}) + math::luminance({l.c[3], l.c[4], l.c[5]});
}

/// The light's luminance by two halves of the samples.
struct Luminances {
  float a = 0, b = 0;

  Luminances& add(float weight, const Luminances& o) {
    a += weight * o.a, b += weight * o.b;
    return *this;
  }
};

/// The filters are none, the narrow one, the wide one, and both in turn.
constexpr std::size_t kFilters = 4;
using Errors = std::array<float, kFilters>;

/// Returns the outer product of a row of five weights.
constexpr std::array<float, kCount> kernel(std::array<float, 5> row) {
  std::array<float, kCount> k{};
  for (int i = 0; i < kCount; ++i)
    k[std::size_t(i)] = row[std::size_t(i % 5)] * row[std::size_t(i / 5)];
  return k;
}
/// The kernels are a cubic B-spline and a tent.
constexpr std::array<float, kCount> kNarrow =
    kernel({1 / 16.f, 4 / 16.f, 6 / 16.f, 4 / 16.f, 1 / 16.f});
constexpr std::array<float, kCount> kWide = kernel({1 / 9.f, 2 / 9.f, 3 / 9.f, 2 / 9.f, 1 / 9.f});

/// The least share of the variance that each filter leaves: the sum of its squared weights, when
/// all texels around are alike.
constexpr Errors kLeft{1, 0.075f, 0.055f, 0.033f};

/// The weights of the texels around, in 255ths; 255 for the texel itself.
using Weights = std::array<std::uint8_t, kCount>;

/// Returns how well the surface at `n` continues that at `t`.
std::uint8_t similarity(const atlas::TextureGroup& texels, const lightmap::Plane<float>& validity,
                        std::uint32_t t, std::uint32_t n) {
  const auto is_hidden = [&](std::uint32_t i) { return validity[i] < lightmap::kValidShare; };
  if (is_hidden(t) != is_hidden(n)) return 0;
  const math::Vec3 a = texels.shading_normal[t], b = texels.shading_normal[n];
  float turn = std::max(0.f, dot(a, b));
  turn *= turn, turn *= turn, turn *= turn, turn *= turn;  // to the 16th
  const math::Vec3 d = texels.position[n] - texels.position[t];
  const float size2 = texels.area_m2[t] / texels.coverage[t];
  constexpr float kFarTexels = 8;
  if (dot(d, d) > kFarTexels * kFarTexels * size2) return 0;
  // Half a texel out of the plane halves the weight; two texels leave next to none.
  const float off = dot(d, a) * dot(d, a) + dot(d, b) * dot(d, b);
  const float fall = size2 > 0 ? 1 + 2 * off / size2 : 1;
  return std::uint8_t(255 * std::min(1.f, turn / (fall * fall)) + 0.5f);
}

/// Holds the texels around each texel that are alike.
class SimilarityWeights {
 public:
  SimilarityWeights(const atlas::TextureGroup& texels, const SurfaceNeighbors& neighbors,
                    const lightmap::Lightmap& light)
      : texels_(texels), neighbors_(neighbors), light_(light), weight_(texels.size()) {}

  /// Fills the weights of a texel. It is called for every texel before visit() is of use.
  void compare(std::uint32_t t) {
    const auto around = neighbors_.of(t);
    for (std::size_t k = 0; k < kCount; ++k)
      weight_[t][k] = around[k] == atlas::kNoTexel
                          ? std::uint8_t(0)
                          : similarity(texels_, light_.validity, t, std::uint32_t(around[k]));
  }

  /// Calls `use(k, texel, weight)` for the texels around that are alike, itself among them.
  template <class Use>
  void visit(std::uint32_t t, const Use& use) const {
    const auto around = neighbors_.of(t);
    for (std::size_t k = 0; k < kCount; ++k)
      if (weight_[t][k] > 0) use(k, std::uint32_t(around[k]), float(weight_[t][k]));
  }

 private:
  const atlas::TextureGroup& texels_;
  const SurfaceNeighbors& neighbors_;
  const lightmap::Lightmap& light_;
  std::vector<Weights> weight_;
};

/// Applies the filters to one signal, in steps. Each step reads what the steps before left of the
/// texels around.
template <class Color>
class Filtering {
 public:
  Filtering(const SimilarityWeights& around, std::uint32_t texels)
      : around_(around), color_(texels), none_(texels) {}

  void set(std::uint32_t t, const Color& mean, float half_difference) {
    color_[t] = mean;
    const float all = all_light(mean);
    none_[t] = {all + half_difference, all - half_difference};
  }

  /// Returns the variance of the light by its two halves, averaged over the texels around.
  float variance(std::uint32_t t) const {
    float sum = 0, weight = 0;
    around_.visit(t, [&](std::size_t, std::uint32_t n, float w) {
      const float d = (none_[n].a - none_[n].b) / 2;
      sum += w * d * d, weight += w;
    });
    return sum / weight;
  }

  void allocate() {
    narrow_.resize(none_.size());
    wide_.resize(none_.size());
    wide_color_.resize(none_.size());
    errors_.resize(none_.size());
    smooth_errors_.resize(none_.size());
  }
  void smooth_once(std::uint32_t t) {
    Luminances narrow, wide;
    Color color{};
    float narrow_weight = 0, wide_weight = 0;
    around_.visit(t, [&](std::size_t k, std::uint32_t n, float w) {
      const float nw = w * kNarrow[k], ww = w * kWide[k];
      narrow.add(nw, none_[n]), narrow_weight += nw;
      wide.add(ww, none_[n]), wide_weight += ww;
      color.add(ww, color_[n]);
    });
    narrow_[t] = Luminances{}.add(1 / narrow_weight, narrow);
    wide_[t] = Luminances{}.add(1 / wide_weight, wide);
    wide_color_[t] = Color{}.add(1 / wide_weight, color);
  }

  void smooth_twice(std::uint32_t t) {
    Luminances sum;
    float weight = 0;
    around_.visit(t, [&](std::size_t k, std::uint32_t n, float w) {
      sum.add(w * kNarrow[k], wide_[n]), weight += w * kNarrow[k];
    });
    const Luminances both = Luminances{}.add(1 / weight, sum);
    const float a = none_[t].a, b = none_[t].b;
    const std::array<Luminances, kFilters> filtered{none_[t], narrow_[t], wide_[t], both};
    for (std::size_t c = 0; c < kFilters; ++c) {
      const float fa = filtered[c].a, fb = filtered[c].b;
      errors_[t][c] = ((fa - b) * (fa - b) + (fb - a) * (fb - a) - (a - b) * (a - b)) / 2 -
                      (fa - fb) * (fa - fb) / 4;
    }
  }

  void smooth_errors(std::uint32_t t) { smooth_errors_[t] = mean(errors_, t); }

  struct Chosen {
    Color light;
    float variance = 0;

    math::Rgb first_three() const { return {light.c[0], light.c[1], light.c[2]}; }
  };
  Chosen choose(std::uint32_t t) const {
    Errors e = mean(smooth_errors_, t);
    // By chance the estimated error of a filter falls below the noise that it leaves, even below
    // zero. The error of no filter is the variance itself.
    for (std::size_t c = 0; c < kFilters; ++c) e[c] = std::max(e[c], kLeft[c] * e[0]);
    const float least = *std::min_element(e.begin(), e.end());
    const std::array<Color, kFilters> filtered{color_[t], narrowed(color_, t), wide_color_[t],
                                               narrowed(wide_color_, t)};
    Color sum{};
    float weight = 0, error = 0;
    // The light's own rounding sets the scale below which errors are alike.
    const float level = 1e-5f * (std::abs(none_[t].a) + std::abs(none_[t].b));
    const float floor = 0.05f * least + level * level + 1e-30f;
    for (std::size_t c = 0; c < kFilters; ++c) {
      const float ratio = (least + floor) / (e[c] + floor);
      const float w = ratio * ratio;
      sum.add(w, filtered[c]);
      error += w * e[c], weight += w;
    }
    return {Color{}.add(1 / weight, sum), error / weight};
  }

 private:
  /// Applies the narrow filter. The colors of the narrow filters are computed on use, since they
  /// would be half of the memory.
  Color narrowed(const std::vector<Color>& color, std::uint32_t t) const {
    Color sum{};
    float weight = 0;
    around_.visit(t, [&](std::size_t k, std::uint32_t n, float w) {
      sum.add(w * kNarrow[k], color[n]), weight += w * kNarrow[k];
    });
    return Color{}.add(1 / weight, sum);
  }

  /// Returns the mean of the errors over the texels around.
  Errors mean(const std::vector<Errors>& errors, std::uint32_t t) const {
    Errors sum{};
    float weight = 0;
    around_.visit(t, [&](std::size_t, std::uint32_t n, float w) {
      for (std::size_t c = 0; c < kFilters; ++c) sum[c] += w * errors[n][c];
      weight += w;
    });
    for (float& e : sum) e /= weight;
    return sum;
  }

  const SimilarityWeights& around_;
  std::vector<Color> color_, wide_color_;
  std::vector<Luminances> none_, narrow_, wide_;
  std::vector<Errors> errors_, smooth_errors_;
};

/// Runs a step over all texels; false when stopped.
using Each = std::function<bool(const std::function<void(std::uint32_t)>&)>;

/// Filters a signal, or only estimates its variance when it is not to be smoothed.
/// @param set puts the light of a texel into the signal
/// @param put takes the filtered light
/// @param put_variance takes the variance
template <class Color, class Set, class Put, class PutVariance>
bool filter(Filtering<Color> signal, const Each& each, bool smooth, const Set& set, const Put& put,
            const PutVariance& put_variance) {
  if (!each([&](std::uint32_t t) { set(signal, t); })) return false;
  if (!smooth) return each([&](std::uint32_t t) { put_variance(t, signal.variance(t)); });
  signal.allocate();
  return each([&](std::uint32_t t) { signal.smooth_once(t); }) &&
         each([&](std::uint32_t t) { signal.smooth_twice(t); }) &&
         each([&](std::uint32_t t) { signal.smooth_errors(t); }) && each([&](std::uint32_t t) {
           const auto chosen = signal.choose(t);
           put(t, chosen);
           put_variance(t, chosen.variance);
         });
}

}  // namespace

std::optional<FilteredLight> FilterBank::run(const lightmap::Lightmap& light,
                                             const exec::Workers& workers) {
  if (!linked_ && !(linked_ = neighbors_.link(workers))) return std::nullopt;
  const std::uint32_t count = light.size();
  const Each each = [&](const std::function<void(std::uint32_t)>& use) {
    return workers.for_runs(count, kRunTexels, [&](auto begin, auto end) {
      for (std::uint32_t t = begin; t < end; ++t) use(t);
    });
  };
  SimilarityWeights around(texels_, neighbors_, light);
  if (!each([&](std::uint32_t t) { around.compare(t); })) return std::nullopt;
  FilteredLight out{light.direct, light.sky, light.indirect, lightmap::Plane<float>(count),
                    lightmap::Plane<float>(count)};
  if (smooth_)
    for (auto* plane : {&out.direct, &out.sky, &out.indirect}) plane->clear();
  const bool direct = filter(
      Filtering<PlainColor>(around, count), each, smooth_,
      [&](auto& signal, std::uint32_t t) {
        const math::Rgb d = light.direct[t];
        signal.set(t, {{d.r, d.g, d.b, 0}}, light.direct_difference[t]);
      },
      [&](std::uint32_t t, const auto& chosen) { out.direct[t] = chosen.first_three(); },
      [&](std::uint32_t t, float variance) { out.direct_variance[t] = variance; });
  if (!direct) return std::nullopt;
  const auto put_variance = [&](std::uint32_t t, float variance) {
    out.gathered_variance[t] = variance;
  };
  const auto difference = [&](std::uint32_t t) {
    return light.indirect_difference[t] + light.sky_difference[t];
  };
  bool gathered = false;
  if (has_sky_map_) {
    gathered = filter(
        Filtering<SkyColor>(around, count), each, smooth_,
        [&](auto& signal, std::uint32_t t) {
          const math::Rgb i = light.indirect[t], s = light.sky[t];
          signal.set(t, {{i.r, i.g, i.b, s.r, s.g, s.b}}, difference(t));
        },
        [&](std::uint32_t t, const auto& chosen) {
          out.indirect[t] = chosen.first_three();
          out.sky[t] = {chosen.light.c[3], chosen.light.c[4], chosen.light.c[5]};
        },
        put_variance);
  } else {
    // A sky that is uniform over all directions has one color on all texels.
    const math::Rgb color = is_black(sky_) ? sky_ : sky_ * (1 / luminance(sky_));
    gathered = filter(
        Filtering<PlainColor>(around, count), each, smooth_,
        [&](auto& signal, std::uint32_t t) {
          const math::Rgb i = light.indirect[t];
          signal.set(t, {{i.r, i.g, i.b, luminance(light.sky[t])}}, difference(t));
        },
        [&](std::uint32_t t, const auto& chosen) {
          out.indirect[t] = chosen.first_three(), out.sky[t] = color * chosen.light.c[3];
        },
        put_variance);
  }
  if (!gathered) return std::nullopt;
  return out;
}

}  // namespace kiln::denoise
