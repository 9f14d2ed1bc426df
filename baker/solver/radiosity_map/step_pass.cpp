#include "baker/solver/radiosity_map/step_pass.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "baker/solver/gather/outgoing_radiosity.h"

namespace kiln::solver::radiosity_map {
namespace {

using enum lightmap::PlaneId;
using gather::Hemisphere;

/// Directions that are followed at a time, so that their hits take little memory.
constexpr std::uint32_t kSetDirections = 256;
/// Samples of one batch, about; batches are whole tiles.
constexpr std::uint32_t kBatchSamples = 1u << 17;
constexpr std::uint32_t kMostBatchTexels = 1024;

class StepPass final : public Pass {
 public:
  StepPass(const Parts& parts, PassPlan plan, const Step& step)
      : Pass(std::move(plan)),
        parts_(parts),
        step_(step),
        radiosity_(parts.world, parts.emittance) {
    plan_.completes = step.completes;
    plan_.name = step.name;
    plan_.work = step_work(parts, step);
    const std::uint32_t samples = step.direct.count + step.trace.count + step.read.count;
    plan_.batch_texels = std::clamp(kBatchSamples / std::max(1u, samples) / Hemisphere::kTileTexels,
                                    1u, kMostBatchTexels / Hemisphere::kTileTexels) *
                         Hemisphere::kTileTexels;
    declare_planes();
    if (!step.keeps_hits)
      for (std::uint32_t at = step.trace.first; at < step.trace.end(); at += kSetDirections)
        sets_.push_back(parts.directions({at, std::min(kSetDirections, step.trace.end() - at)}));
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    if (step_.read.count == 0) return true;
    radiosity_.find_hidden(before);
    // The mean of the averaged series has no end but this to its orders of reflection.
    const bool once =
        !sends_terms() && bounce_limit(parts_.world.settings) == 1 && !parts_.emittance.empty();
    return radiosity_.read(before, workers, once);
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    if (step_.direct.count > 0)
      for (std::uint32_t t = range.begin; t < range.end; ++t) add_direct(t, before, after, rays);
    if (step_.keeps_hits) rays += trace(range, parts_.kept, before, after);
    for (const sampling::DirectionSet& set : sets_) rays += trace(range, set, before, after);
    if (reads_kept_hits())
      for (std::uint32_t t = range.begin; t < range.end; ++t) read_kept(t, before, after);
    if (sends_terms())
      for (std::uint32_t t = range.begin; t < range.end; ++t)
        after.radiosity[t] = before.radiosity[t] + radiosity_.radiosity(t);
    return rays;
  }

 private:
  bool reads_kept_hits() const { return step_.read.count > 0 && step_.trace.count == 0; }
  /// Returns whether the pass is a bounce of the unbiased series, which reads what the one before
  /// has added, and adds to the light.
  bool sends_terms() const {
    return step_.read.count > 0 && parts_.world.settings.series == proto::Series::kUnbiased;
  }

  void declare_planes() {
    if (step_.direct.count > 0)
      plan_.writes |= lightmap::plane_set({kDirect, kDirectDifference, kDirectSamples});
    if (step_.trace.count > 0) plan_.writes |= lightmap::plane_set({kSamples});
    if (step_.finds_sky) plan_.writes |= lightmap::plane_set({kSky, kSkyDifference});
    if (step_.probes) plan_.writes |= lightmap::plane_set({kValidity});
    if (step_.keeps_hits) plan_.writes |= lightmap::plane_set({kHits});
    if (step_.read.count > 0) {
      plan_.writes |= lightmap::plane_set({kIndirect, kIndirectDifference});
      plan_.reads |= lightmap::plane_set({kDirect, kSky, kIndirect, kValidity});
    }
    if (reads_kept_hits()) plan_.reads |= lightmap::plane_set({kHits});
    if (sends_terms()) {
      plan_.writes |= lightmap::plane_set({kRadiosity});
      plan_.reads |= lightmap::plane_set({kRadiosity});
    }
    plan_.reads |= plan_.writes;
  }

  void add_direct(std::uint32_t t, const lightmap::Lightmap& before,
                  const lightmap::LightmapView& after, std::uint64_t& rays) const {
    const sampling::Estimate e = parts_.emitters.arriving(t, step_.direct, rays);
    const std::uint32_t had = step_.direct.first, more = step_.direct.count;
    after.direct[t] = sampling::joined(before.direct[t], had, e.mean, more);
    after.direct_difference[t] =
        sampling::joined(before.direct_difference[t], had, e.half_difference, more);
    after.direct_samples[t] = had + more;
  }

  /// Follows directions of all texels of a range, which is made of whole tiles.
  /// @return rays traced
  std::uint64_t trace(atlas::TexelRange range, const sampling::DirectionSet& set,
                      const lightmap::Lightmap& before, const lightmap::LightmapView& after) const {
    std::vector<std::uint32_t> hits;
    if (!step_.keeps_hits) hits.resize(std::size_t(Hemisphere::kTileTexels) * set.size());
    std::array<Hemisphere::Gathering, Hemisphere::kTileTexels> all;
    for (std::uint32_t begin = range.begin; begin < range.end; begin += Hemisphere::kTileTexels) {
      const std::uint32_t count = std::min(Hemisphere::kTileTexels, range.end - begin);
      const std::span texels = std::span(all).first(count);
      for (std::uint32_t i = 0; i < count; ++i)
        texels[i] = {begin + i, step_.keeps_hits
                                    ? after.hits.of(begin + i)
                                    : std::span(hits).subspan(i * set.size(), set.size())};
      if (step_.probes && set.first == 0)
        parts_.hemisphere.follow_and_probe(texels, set);
      else
        parts_.hemisphere.follow(texels, set);
      for (const Hemisphere::Gathering& g : texels) take(g, set, before, after);
    }
    return std::uint64_t(range.size()) * set.size();
  }

  void take(const Hemisphere::Gathering& g, const sampling::DirectionSet& set,
            const lightmap::Lightmap& before, const lightmap::LightmapView& after) const {
    const std::uint32_t t = g.texel, more = set.size();
    // The first set of the pass joins the light before, the others what is there by then.
    const bool first = set.first == step_.trace.first;
    const std::uint32_t had = sends_terms() ? set.first - step_.trace.first : set.first;
    if (step_.probes && set.first == 0) after.validity[t] = g.visible;
    if (step_.finds_sky) {
      const sampling::Estimate e = parts_.hemisphere.sky_light(set, g);
      after.sky[t] = sampling::joined(first ? before.sky[t] : after.sky[t], had, e.mean, more);
      after.sky_difference[t] = sampling::joined(
          first ? before.sky_difference[t] : after.sky_difference[t], had, e.half_difference, more);
    }
    after.samples[t] = had + more;
    if (step_.read.count == 0) return;
    const sampling::Estimate e = radiosity_.look_up(set, g.hits);
    if (sends_terms()) {
      const float share = float(more) / float(step_.read.count);
      after.indirect[t] = (first ? before.indirect[t] : after.indirect[t]) + e.mean * share;
      after.indirect_difference[t] =
          (first ? before.indirect_difference[t] : after.indirect_difference[t]) +
          e.half_difference * share;
    } else {
      after.indirect[t] = sampling::joined(before.indirect[t], had, e.mean, more);
      after.indirect_difference[t] =
          sampling::joined(before.indirect_difference[t], had, e.half_difference, more);
    }
  }

  /// Iterations over kept hits. The halves are those of all kept directions: after some of them
  /// alone, the difference is larger than it should be.
  void read_kept(std::uint32_t t, const lightmap::Lightmap& before,
                 const lightmap::LightmapView& after) const {
    const auto hits = before.hits.of(t);
    sampling::HalfSums sums;
    for (std::uint32_t i = step_.read.first; i < step_.read.end(); ++i)
      if (hits[i] < simd::kHitSky)
        sums.half[parts_.kept.in_second_half(i)] += radiosity_.radiosity(hits[i]);
    const sampling::Estimate e = sums.estimate();
    const std::uint32_t had = step_.read.first, more = step_.read.count;
    const float scale = 1 / float(more),
                correction = parts_.kept.is_low_discrepancy ? sampling::kNetCorrection : 1;
    after.indirect[t] = sampling::joined(before.indirect[t], had, e.mean * scale, more);
    after.indirect_difference[t] = sampling::joined(before.indirect_difference[t], had,
                                                    e.half_difference * scale * correction, more);
  }

  const Parts& parts_;
  const Step step_;
  gather::OutgoingRadiosity radiosity_;
  std::vector<sampling::DirectionSet> sets_;  ///< to follow; none when their hits are kept
};

}  // namespace

Parts::Parts(const World& w, std::uint32_t count)
    : world(w),
      packets(w, std::max(count, kKeptDirections)),
      hemisphere(w, packets),
      emitters(w),
      kept(directions({0, count})),
      emittance(sent_emittance(w)) {}

sampling::DirectionSet Parts::directions(Run run) const {
  return {run.first, run.count, packets.sorts_directions(),
          world.settings.uses(proto::Technique::kLowDiscrepancy)};
}

std::unique_ptr<Pass> make_step_pass(const Parts& parts, PassPlan plan, const Step& step) {
  return std::make_unique<StepPass>(parts, std::move(plan), step);
}

Work step_work(const Parts& parts, const Step& step) {
  return Work::shadow_rays(step.direct.count * parts.emitters.rays_per_sample()) +
         Work::directions(work::kDirection * step.trace.count) +
         Work::other(step.read.count > 0 ? work::kTexel + work::kLookUp * step.read.count : 0);
}

}  // namespace kiln::solver::radiosity_map
