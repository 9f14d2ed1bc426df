#include "baker/solver/adaptive/error.h"

#include <algorithm>
#include <cmath>

#include "baker/solver/adaptive/tuned.h"

namespace kiln::solver::adaptive {
namespace {

double percentile_of_all(const World& world, const lightmap::Lightmap& light,
                         const Judgement& judgement) {
  std::vector<float> judged;
  for (std::uint32_t t = 0; t < light.size(); ++t)
    if (is_judged(world, light, t)) judged.push_back(judgement.error[t]);
  return double(percentile_95(judged));
}

double root_mean_square(const World& world, const lightmap::Lightmap& light,
                        const Judgement& judgement) {
  double mean = 0, square = 0;
  std::uint32_t judged = 0;
  for (std::uint32_t t = 0; t < light.size(); ++t) {
    if (!is_judged(world, light, t)) continue;
    mean += double(judgement.luminance_of(t)), square += double(judgement.variance_of(t));
    ++judged;
  }
  return mean > 0 ? std::sqrt(square * judged) / mean : 0;
}

}  // namespace

float percentile_95(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto at = values.end() - 1 - std::ptrdiff_t(values.size() / 20);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

float Judgement::luminance_of(std::uint32_t t) const {
  return luminance(filtered.direct[t] + filtered.sky[t] + filtered.indirect[t]);
}

float Judgement::variance_of(std::uint32_t t) const {
  return filtered.direct_variance[t] + filtered.gathered_variance[t];
}

ErrorJudge::ErrorJudge(const World& world, bool smooth)
    : world_(world), bank_(world.texels, world.scene.sky, smooth, world.lights.sky() != nullptr) {}

std::optional<Judgement> ErrorJudge::judge(const lightmap::Lightmap& light,
                                           const exec::Workers& workers) {
  auto filtered = bank_.run(light, workers);
  if (!filtered) return std::nullopt;
  Judgement judgement{std::move(*filtered), {}, 0};
  fill_errors(judgement);
  judgement.standard_error = world_.plan.measure == proto::ErrorMeasure::kRms
                                 ? root_mean_square(world_, light, judgement)
                                 : percentile_of_all(world_, light, judgement);
  return judgement;
}

/// Fills in the relative error of every texel.
void ErrorJudge::fill_errors(Judgement& judgement) const {
  const atlas::TextureGroup& texels = world_.texels;
  double sum = 0, area = 0;
  for (std::uint32_t t = 0; t < texels.front_count; ++t) {
    sum += double(texels.area_m2[t]) * double(judgement.luminance_of(t));
    area += double(texels.area_m2[t]);
  }
  const float dark = area > 0 ? tuned::kDarkShare * float(sum / area) : 0;
  judgement.error.assign(texels.size(), 0);
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    const float e = judgement.luminance_of(t) + dark;
    judgement.error[t] = e > 0 ? std::sqrt(judgement.variance_of(t)) / e : 0;
  }
}

}  // namespace kiln::solver::adaptive
