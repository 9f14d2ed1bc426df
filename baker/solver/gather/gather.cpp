#include "baker/solver/gather/gather.h"

#include <array>
#include <bit>
#include <map>
#include <utility>

#include "baker/solver/adaptive/adaptive_sampling.h"
#include "baker/solver/direct/direct.h"
#include "baker/solver/gather/hemisphere.h"
#include "baker/solver/gather/hit_cache.h"
#include "baker/solver/gather/interpolation_grid.h"
#include "baker/solver/gather/outgoing_radiosity.h"
#include "baker/solver/gather/schedule.h"

namespace kiln::solver::gather {
namespace {

/// Fewest directions that feed the bounces.
constexpr std::uint32_t kMinFeedbackSamples = 16;

class GatherSolver final : public Solver {
  using Schedule = GatherSchedule;

 public:
  GatherSolver(const SolverInput& in, std::uint64_t hit_budget)
      : in_(in),
        plan_(in.plan),
        direct_(in_),
        sites_(in.texels),
        packets_(in_, feedback_samples(in, hit_budget)),
        hemisphere_(in_, packets_),
        feedback_(in_),
        set_(directions(0, feedback_samples(in, hit_budget))),
        rounds_(in_, set_.size()),
        schedule_(in_, set_, rounds_) {
    if (schedule_.needs_rays()) hits_ = HitMemory(in.texels.size(), set_.size());
  }

  std::uint32_t max_passes() const override { return schedule_.max_passes(); }
  Work total_work() const override { return schedule_.total_work(); }
  std::optional<Pass> next(std::span<const proto::PassReport> done) const override {
    return schedule_.next(done);
  }
  double work_share(const Pass& pass, double share) const override {
    return pass.name == Schedule::kRound ? rounds_.work_share(share) : share;
  }
  bool begin(const Pass& pass, const lightmap::Lightmap& before, lightmap::Lightmap& after,
             const exec::Workers& workers) override;
  std::uint64_t run(const Pass& pass, const lightmap::Lightmap& before, atlas::TexelRange range,
                    lightmap::Lightmap& after) override;
  bool finish(const Pass& pass, lightmap::Lightmap& after, const exec::Workers& workers,
              proto::PassReport& report) override;

  std::span<std::byte> state() override { return hits_.bytes(); }

  std::optional<denoise::FilteredLight> filtered(const lightmap::Lightmap& light,
                                                 const exec::Workers& workers) override {
    return rounds_.filtered(light, workers);
  }
  std::string ray_pattern() const override { return schedule_.needs_rays() ? packets_.name() : ""; }

 private:
  static_assert(Hemisphere::kTileTexels == adaptive::SampleRounds::kTileTexels);
  static std::uint32_t feedback_samples(const SolverInput& in, std::uint64_t budget) {
    const std::uint32_t wanted = in.plan.directions;
    const std::uint64_t affordable =
        budget / (sizeof(std::uint32_t) * std::max(1u, in.texels.size()));
    if (wanted <= affordable) return wanted;
    const std::uint64_t fitting = std::bit_floor(std::max<std::uint64_t>(1, affordable));
    return std::min(wanted, std::max(kMinFeedbackSamples, std::uint32_t(fitting)));
  }

  sampling::DirectionSet directions(std::uint32_t first, std::uint32_t count) const {
    return {first, count, packets_.sorts_directions(),
            in_.settings.uses(proto::Technique::kLowDiscrepancy)};
  }

  /// E = π · mean L over cosine-distributed directions.
  sampling::Estimate sky_light(const sampling::DirectionSet& set,
                               const Hemisphere::Gathering& g) const {
    if (in_.lights.sky()) return set.estimate(g.sky[0] * math::kPi, g.sky[1] * math::kPi);
    float open[2] = {0, 0};
    for (std::uint32_t i = 0; i < g.hits.size(); ++i)
      open[set.in_second_half(i)] += g.hits[i] == simd::kHitSky ? math::kPi : 0.f;
    return set.estimate(in_.scene.sky * open[0], in_.scene.sky * open[1]);
  }

  static void put(const sampling::Estimate& e, math::Rgb& mean, float& spread) {
    mean = e.mean, spread = e.spread;
  }
  void own_planes(const Pass& pass, lightmap::Lightmap& after) const;
  void guess_rounds(const Pass&, const lightmap::Lightmap& after);

  bool begin_round(const lightmap::Lightmap& before, const exec::Workers&);

  /// Sums what `use` gives for the tiles of a range.
  template <class Use>
  static std::uint64_t for_tiles(atlas::TexelRange range, const Use& use) {
    std::uint64_t sum = 0;
    for (std::uint32_t t = range.begin; t < range.end; t += Hemisphere::kTileTexels)
      sum += use(atlas::TexelRange{t, std::min(t + Hemisphere::kTileTexels, range.end)});
    return sum;
  }
  template <class Wanted>
  std::uint64_t trace_some(atlas::TexelRange tile, lightmap::Lightmap& after, const Wanted&);
  std::uint64_t trace(atlas::TexelRange range, lightmap::Lightmap& after);
  std::uint64_t refine(atlas::TexelRange range, const lightmap::Lightmap& before,
                       lightmap::Lightmap& after);
  void bounce(const Pass&, const lightmap::Lightmap& before, atlas::TexelRange range,
              lightmap::Lightmap& after);
  std::uint64_t add_samples(atlas::TexelRange range, lightmap::Lightmap& light);
  std::uint64_t add_shadow_rays(atlas::TexelRange tile, lightmap::Lightmap& light);
  std::uint64_t add_directions(atlas::TexelRange tile, const sampling::DirectionSet&,
                               lightmap::Lightmap& light);
  bool interpolate(const Pass&, lightmap::Lightmap& light, const exec::Workers&);

  const SolverInput in_;
  const SamplePlan plan_;
  direct::DirectLight direct_;
  const CoarseSites sites_;
  const PacketPlan packets_;
  const Hemisphere hemisphere_;
  Feedback feedback_;
  const sampling::DirectionSet set_;  ///< of the rays whose hits are remembered
  adaptive::SampleRounds rounds_;
  const GatherSchedule schedule_;
  std::map<std::uint32_t, sampling::DirectionSet>
      leading_;  ///< of those that a bounce reads, by their count
  std::map<std::uint32_t, sampling::DirectionSet>
      more_;  ///< those of a round, by the samples before them
  HitMemory hits_;
};

/// Makes those planes the pass's own that it changes.
void GatherSolver::own_planes(const Pass& pass, lightmap::Lightmap& after) const {
  const bool round = pass.name == Schedule::kRound, bounces = Schedule::is_bounce(pass);
  if (pass.name == Schedule::kDirect || (round && rounds_.adds_shadow_rays()))
    after.direct.own(), after.direct_spread.own(), after.direct_samples.own();
  if (pass.name == Schedule::kTrace || pass.name == Schedule::kRefine)
    after.validity.own(), after.gathers.own();
  if (bounces) after.radiosity.renew();
  if (pass.name == Schedule::kDirect || (round && !rounds_.adds_directions())) return;
  after.indirect.own(), after.indirect_spread.own();
  if (!bounces) after.sky.own(), after.sky_spread.own(), after.samples.own();
}

bool GatherSolver::begin(const Pass& pass, const lightmap::Lightmap& before,
                         lightmap::Lightmap& after, const exec::Workers& workers) {
  const bool bounces = Schedule::is_bounce(pass);
  if (bounces && !feedback_.knows_hidden()) feedback_.find_hidden(before);
  if ((bounces || (pass.name == Schedule::kTrace && plan_.coarse)) &&
      !feedback_.read(before, workers))
    return false;
  if (pass.name == Schedule::kTail) feedback_.scale(1 + float(pass.tail_scale));
  if (bounces) leading_.try_emplace(pass.sample_count, set_.leading(pass.sample_count));
  if (pass.name == Schedule::kRound && !begin_round(before, workers)) return false;
  own_planes(pass, after);
  return true;
}

bool GatherSolver::begin_round(const lightmap::Lightmap& before, const exec::Workers& workers) {
  hits_.forget();
  feedback_.restore(before.radiosity);
  if (!rounds_.begin(before, workers)) return false;
  more_.clear();
  for (const std::uint32_t first : rounds_.first_directions())
    more_.emplace(first, directions(first, rounds_.more_directions(first)));
  return true;
}

std::uint64_t GatherSolver::run(const Pass& pass, const lightmap::Lightmap& before,
                                atlas::TexelRange range, lightmap::Lightmap& after) {
  if (pass.name == Schedule::kTrace) return trace(range, after);
  if (pass.name == Schedule::kRefine) return refine(range, before, after);
  if (pass.name == Schedule::kRound) return add_samples(range, after);
  if (pass.name == Schedule::kDirect) {
    const std::uint32_t count = plan_.shadow_rays;
    for (std::uint32_t t = range.begin; t < range.end; ++t) after.direct_samples[t] = count;
    return direct_.run(range, 0, count, [&](std::uint32_t t, const sampling::Estimate& e) {
      put(e, after.direct[t], after.direct_spread[t]);
    });
  }
  bounce(pass, before, range, after);
  return 0;
}

/// When something new is known of the light that rounds will sample.
void GatherSolver::guess_rounds(const Pass& pass, const lightmap::Lightmap& after) {
  const bool first_bounce_known =
      plan_.coarse ? pass.name != Schedule::kDirect : pass.index >= schedule_.first_bounce();
  if (pass.completes || pass.index > schedule_.first_bounce()) return;
  rounds_.guess(after, first_bounce_known && in_.settings.bounces > 0
                           ? adaptive::SampleRounds::Known::kFirstBounce
                           : adaptive::SampleRounds::Known::kDirect);
}

bool GatherSolver::finish(const Pass& pass, lightmap::Lightmap& after, const exec::Workers& workers,
                          proto::PassReport& report) {
  if (pass.name == Schedule::kRefine) guess_rounds(pass, after);
  if (pass.name == Schedule::kRefine && in_.settings.bounces > 0) {
    // What the sites were compared by is no bounce yet.
    after.indirect.renew();
    after.indirect_spread.renew();
  }
  if (schedule_.needs_rays() && pass.name != Schedule::kDirect && plan_.coarse &&
      !interpolate(pass, after, workers))
    return false;
  if (pass.name != Schedule::kRefine) guess_rounds(pass, after);
  if (!pass.completes) return true;
  // The memory of what later passes make anew is free for the filter.
  hits_.forget();
  feedback_.forget();
  return rounds_.judge(after, workers, report);
}

std::uint64_t GatherSolver::trace(atlas::TexelRange range, lightmap::Lightmap& after) {
  return for_tiles(range, [&](atlas::TexelRange tile) {
    const std::uint64_t rays = trace_some(tile, after, [&](std::uint32_t t) {
      const bool traced = !plan_.coarse || sites_.around(t).count == 0;
      after.gathers[t] = traced;
      return traced;
    });
    // The first bounce of direct light, for refine() to compare the sites by.
    if (plan_.coarse && in_.settings.bounces > 0)
      for (std::uint32_t t = tile.begin; t < tile.end; ++t)
        if (after.gathers[t])
          put(feedback_.look_up(set_, hits_.of(t)), after.indirect[t], after.indirect_spread[t]);
    return rays;
  });
}

/// Traces the texels of a tile that `wanted` picks, and remembers their hits.
template <class Wanted>
std::uint64_t GatherSolver::trace_some(atlas::TexelRange tile, lightmap::Lightmap& after,
                                       const Wanted& wanted) {
  std::array<Hemisphere::Gathering, Hemisphere::kTileTexels> all;
  std::uint32_t count = 0;
  for (std::uint32_t t = tile.begin; t < tile.end; ++t)
    if (wanted(t)) all[count++] = {t, hits_.of(t)};
  const std::span texels(all.data(), count);
  hemisphere_.follow_and_probe(texels, set_);
  for (const Hemisphere::Gathering& g : texels) {
    after.validity[g.texel] = g.visible;
    put(sky_light(set_, g), after.sky[g.texel], after.sky_spread[g.texel]);
    after.samples[g.texel] = set_.size();
    after.gathers[g.texel] = 1;
  }
  return std::uint64_t(count) * set_.size();
}

/// Traces the texels whose sites do not agree.
std::uint64_t GatherSolver::refine(atlas::TexelRange range, const lightmap::Lightmap& before,
                                   lightmap::Lightmap& after) {
  return for_tiles(range, [&](atlas::TexelRange tile) {
    return trace_some(tile, after, [&](std::uint32_t t) {
      const CoarseSites::Sites sites = sites_.around(t);
      return sites.count > 0 && !sites_.agree(sites, before);
    });
  });
}

void GatherSolver::bounce(const Pass& pass, const lightmap::Lightmap& before,
                          atlas::TexelRange range, lightmap::Lightmap& after) {
  const sampling::DirectionSet& set = leading_.at(pass.sample_count);
  for (std::uint32_t t = range.begin; t < range.end; ++t) {
    if (before.gathers[t]) {
      const sampling::Estimate update = feedback_.look_up(set, hits_.of(t).first(set.size()));
      after.indirect[t] += update.mean;
      after.indirect_spread[t] += update.spread;
    }
    after.radiosity[t] = before.radiosity[t] + feedback_.radiosity(t);
  }
}

std::uint64_t GatherSolver::add_samples(atlas::TexelRange range, lightmap::Lightmap& light) {
  return for_tiles(range, [&](atlas::TexelRange tile) {
    std::uint64_t traced = 0;
    const adaptive::SampleRounds::Doublings times = rounds_.of(tile);
    for (std::uint32_t i = 0; i < times.shadow_rays; ++i) traced += add_shadow_rays(tile, light);
    for (std::uint32_t i = 0; i < times.directions; ++i) {
      const auto set = more_.find(light.samples[tile.begin]);
      if (set != more_.end()) traced += add_directions(tile, set->second, light);
    }
    return traced;
  });
}

std::uint64_t GatherSolver::add_shadow_rays(atlas::TexelRange tile, lightmap::Lightmap& light) {
  const std::uint32_t had = light.direct_samples[tile.begin], more = rounds_.more_shadow_rays(had);
  if (more == 0) return 0;
  return direct_.run(tile, had, more, [&](std::uint32_t t, const sampling::Estimate& e) {
    light.direct[t] = sampling::joined(light.direct[t], had, e.mean, more);
    light.direct_spread[t] = sampling::joined(light.direct_spread[t], had, e.spread, more);
    light.direct_samples[t] = had + more;
  });
}

std::uint64_t GatherSolver::add_directions(atlas::TexelRange tile,
                                           const sampling::DirectionSet& set,
                                           lightmap::Lightmap& light) {
  const std::uint32_t had = set.first, more = set.size();
  std::array<Hemisphere::Gathering, Hemisphere::kTileTexels> all;
  std::uint32_t count = 0;
  std::vector<std::uint32_t> hits(std::size_t(tile.size()) * more);
  for (std::uint32_t t = tile.begin; t < tile.end; ++t) {
    light.samples[t] = had + more;
    const bool gathers = std::as_const(light.gathers)[t] != 0;
    if (gathers) all[count] = {t, std::span(hits).subspan(std::size_t(count) * more, more)};
    count += gathers;
  }
  const std::span texels(all.data(), count);
  hemisphere_.follow(texels, set);
  const auto join = [&](const sampling::Estimate& e, math::Rgb& mean, float& spread) {
    mean = sampling::joined(mean, had, e.mean, more);
    spread = sampling::joined(spread, had, e.spread, more);
  };
  for (const Hemisphere::Gathering& g : texels) {
    const std::uint32_t t = g.texel;
    join(sky_light(set, g), light.sky[t], light.sky_spread[t]);
    if (in_.settings.bounces > 0)
      join(feedback_.look_up(set, g.hits), light.indirect[t], light.indirect_spread[t]);
  }
  return std::uint64_t(count) * more;
}

/// Fills the texels between the sites.
bool GatherSolver::interpolate(const Pass& pass, lightmap::Lightmap& light,
                               const exec::Workers& workers) {
  constexpr std::uint32_t kRunTexels = 4096;
  if (pass.name == Schedule::kRound && !rounds_.adds_directions()) return true;
  const auto fill = [](std::uint32_t t, const CoarseSites::Sites& sites, auto& plane) {
    auto sum = plane[sites.texel[0]];
    for (const std::uint32_t s : sites.all().subspan(1)) sum += plane[s];
    plane[t] = sum * (1 / float(sites.count));
  };
  const bool sky_too = !Schedule::is_bounce(pass);
  return workers.for_runs(in_.texels.size(), kRunTexels, [&](auto begin, auto end) {
    for (std::uint32_t t = begin; t < end; ++t) {
      if (std::as_const(light.gathers)[t]) continue;
      const CoarseSites::Sites sites = sites_.around(t);
      fill(t, sites, light.indirect);
      fill(t, sites, light.indirect_spread);
      if (!sky_too) continue;
      fill(t, sites, light.sky);
      fill(t, sites, light.sky_spread);
      light.samples[t] = std::max(light.samples[t], set_.size());
    }
  });
}

}  // namespace

std::unique_ptr<Solver> make_gather_solver(const SolverInput& in, std::uint64_t hit_budget_bytes) {
  return std::make_unique<GatherSolver>(in, hit_budget_bytes);
}

}  // namespace kiln::solver::gather
