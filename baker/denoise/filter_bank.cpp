#include "baker/denoise/filter_bank.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace kiln::denoise {
namespace {

constexpr std::uint32_t kRunTexels = 2048;
constexpr int kCount = SurfaceNeighbours::kCount;

/// The colour of the light, red, green, blue, and the sky's: its luminance, or if that is not
/// enough its own red, green, blue.
template <std::size_t kChannels>
struct alignas(16) Colour {
  float c[kChannels];

  Colour& add(float weight, const Colour& o) {
    for (std::size_t i = 0; i < kChannels; ++i) c[i] += weight * o.c[i];
    return *this;
  }
};
using PlainColour = Colour<4>;
using SkyColour = Colour<6>;

float all_light(const PlainColour& l) {
  return math::luminance({l.c[0], l.c[1], l.c[2]}) + l.c[3];
}
float all_light(const SkyColour& l) {
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

/// none, the narrow filter, the wide one, and both in turn.
constexpr std::size_t kFilters = 4;
using Errors = std::array<float, kFilters>;

/// Outer product of a row of five weights.
constexpr std::array<float, kCount> kernel(std::array<float, 5> row) {
  std::array<float, kCount> k{};
  for (int i = 0; i < kCount; ++i)
    k[std::size_t(i)] = row[std::size_t(i % 5)] * row[std::size_t(i / 5)];
  return k;
}
/// Cubic B-spline, and a tent.
constexpr std::array<float, kCount> kNarrow =
    kernel({1 / 16.f, 4 / 16.f, 6 / 16.f, 4 / 16.f, 1 / 16.f});
constexpr std::array<float, kCount> kWide = kernel({1 / 9.f, 2 / 9.f, 3 / 9.f, 2 / 9.f, 1 / 9.f});

/// What each filter leaves of the variance at least: the sum of its squared weights, where all
/// texels around are alike.
constexpr Errors kLeft{1, 0.075f, 0.055f, 0.033f};

/// Weights of the texels around, in 255ths; 255 for the texel itself.
using Weights = std::array<std::uint8_t, kCount>;

/// How far the surface at `n` goes on from that at `t`.
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
  // Out of the plane by half a texel halves the weight, by two it is next to nothing.
  const float off = dot(d, a) * dot(d, a) + dot(d, b) * dot(d, b);
  const float fall = size2 > 0 ? 1 + 2 * off / size2 : 1;
  return std::uint8_t(255 * std::min(1.f, turn / (fall * fall)) + 0.5f);
}

/// The texels around each that are alike.
class SimilarityWeights {
 public:
  SimilarityWeights(const atlas::TextureGroup& texels, const SurfaceNeighbours& neighbours,
                    const lightmap::Lightmap& light)
      : texels_(texels), neighbours_(neighbours), light_(light), weight_(texels.size()) {}

  /// To be called of every texel before the others are of use.
  void compare(std::uint32_t t) {
    const auto around = neighbours_.of(t);
    for (std::size_t k = 0; k < kCount; ++k)
      weight_[t][k] = around[k] == atlas::kNoTexel
                          ? std::uint8_t(0)
                          : similarity(texels_, light_.validity, t, std::uint32_t(around[k]));
  }

  /// Calls `use(k, texel, weight)` for the texels around that are alike, itself among them.
  template <class Use>
  void visit(std::uint32_t t, const Use& use) const {
    const auto around = neighbours_.of(t);
    for (std::size_t k = 0; k < kCount; ++k)
      if (weight_[t][k] > 0) use(k, std::uint32_t(around[k]), float(weight_[t][k]));
  }

 private:
  const atlas::TextureGroup& texels_;
  const SurfaceNeighbours& neighbours_;
  const lightmap::Lightmap& light_;
  std::vector<Weights> weight_;
};

/// The filters over one signal, in steps; each reads what the steps before left of the texels
/// around.
template <class Colour>
class Filtering {
 public:
  Filtering(const SimilarityWeights& around, std::uint32_t texels)
      : around_(around), colour_(texels), none_(texels) {}

  void set(std::uint32_t t, const Colour& mean, float half_difference) {
    colour_[t] = mean;
    const float all = all_light(mean);
    none_[t] = {all + half_difference, all - half_difference};
  }

  /// How the halves say that the light varies, averaged over the texels around.
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
    wide_colour_.resize(none_.size());
    errors_.resize(none_.size());
    smooth_errors_.resize(none_.size());
  }
  void smooth_once(std::uint32_t t) {
    Luminances narrow, wide;
    Colour colour{};
    float narrow_weight = 0, wide_weight = 0;
    around_.visit(t, [&](std::size_t k, std::uint32_t n, float w) {
      const float nw = w * kNarrow[k], ww = w * kWide[k];
      narrow.add(nw, none_[n]), narrow_weight += nw;
      wide.add(ww, none_[n]), wide_weight += ww;
      colour.add(ww, colour_[n]);
    });
    narrow_[t] = Luminances{}.add(1 / narrow_weight, narrow);
    wide_[t] = Luminances{}.add(1 / wide_weight, wide);
    wide_colour_[t] = Colour{}.add(1 / wide_weight, colour);
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
    Colour light;
    float variance = 0;

    math::Rgb first_three() const { return {light.c[0], light.c[1], light.c[2]}; }
  };
  Chosen choose(std::uint32_t t) const {
    Errors e = mean(smooth_errors_, t);
    // By chance the errors told of a filter come out below what it leaves of the noise, even below
    // zero; that of no filter is the variance itself.
    for (std::size_t c = 0; c < kFilters; ++c) e[c] = std::max(e[c], kLeft[c] * e[0]);
    const float least = *std::min_element(e.begin(), e.end());
    const std::array<Colour, kFilters> filtered{colour_[t], narrowed(colour_, t), wide_colour_[t],
                                                narrowed(wide_colour_, t)};
    Colour sum{};
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
    return {Colour{}.add(1 / weight, sum), error / weight};
  }

 private:
  /// Through the narrow filter. The colours of the narrow filters are made where they are used:
  /// they would be half of the memory.
  Colour narrowed(const std::vector<Colour>& colour, std::uint32_t t) const {
    Colour sum{};
    float weight = 0;
    around_.visit(t, [&](std::size_t k, std::uint32_t n, float w) {
      sum.add(w * kNarrow[k], colour[n]), weight += w * kNarrow[k];
    });
    return Colour{}.add(1 / weight, sum);
  }

  /// Over the texels around.
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
  std::vector<Colour> colour_, wide_colour_;
  std::vector<Luminances> none_, narrow_, wide_;
  std::vector<Errors> errors_, smooth_errors_;
};

/// Runs a step over all texels; false when stopped.
using Each = std::function<bool(const std::function<void(std::uint32_t)>&)>;

/// Filters a signal, or, if it is not to be smoothed, tells its variance.
/// @param set puts the light of a texel into the signal
/// @param put takes the filtered light; @param put_variance the variance alone
template <class Colour, class Set, class Put, class PutVariance>
bool filter(Filtering<Colour> signal, const Each& each, bool smooth, const Set& set, const Put& put,
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
  if (!linked_ && !(linked_ = neighbours_.link(workers))) return std::nullopt;
  const std::uint32_t count = light.size();
  const Each each = [&](const std::function<void(std::uint32_t)>& use) {
    return workers.for_runs(count, kRunTexels, [&](auto begin, auto end) {
      for (std::uint32_t t = begin; t < end; ++t) use(t);
    });
  };
  SimilarityWeights around(texels_, neighbours_, light);
  if (!each([&](std::uint32_t t) { around.compare(t); })) return std::nullopt;
  FilteredLight out{light.direct, light.sky, light.indirect, lightmap::Plane<float>(count),
                    lightmap::Plane<float>(count)};
  if (smooth_)
    for (auto* plane : {&out.direct, &out.sky, &out.indirect}) plane->clear();
  const bool direct = filter(
      Filtering<PlainColour>(around, count), each, smooth_,
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
        Filtering<SkyColour>(around, count), each, smooth_,
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
    // Uniform over all directions, the sky has one colour on all texels.
    const math::Rgb colour = is_black(sky_) ? sky_ : sky_ * (1 / luminance(sky_));
    gathered = filter(
        Filtering<PlainColour>(around, count), each, smooth_,
        [&](auto& signal, std::uint32_t t) {
          const math::Rgb i = light.indirect[t];
          signal.set(t, {{i.r, i.g, i.b, luminance(light.sky[t])}}, difference(t));
        },
        [&](std::uint32_t t, const auto& chosen) {
          out.indirect[t] = chosen.first_three(), out.sky[t] = colour * chosen.light.c[3];
        },
        put_variance);
  }
  if (!gathered) return std::nullopt;
  return out;
}

}  // namespace kiln::denoise
