#pragma once

#include "baker/lightmap/lightmap.h"
#include "baker/solver/adaptive/rounds.h"
#include "baker/solver/pass.h"
#include "baker/solver/work.h"
#include "baker/solver/world.h"

namespace kiln::solver::adaptive {

/// Predicts what filtering, judging and all rounds of a bake will cost, for the remaining time
/// only. It learns from every pass. One thread uses it at a time.
class RoundForecast {
 public:
  /// @param smooth the light will be filtered
  RoundForecast(const World&, const AdaptiveSampling&, const SamplePlan&, bool smooth);

  /// Learns from a pass that left the light incomplete. It guesses by how the samples scatter,
  /// and by what is usual for the light that is not known yet.
  void guess(const lightmap::Lightmap&, Shows);
  /// Learns from a pass that left the light complete.
  void see(const RoundOutlook&);

  /// Returns the work of all rounds, those done included, and of every judgement.
  Work expected_work() const { return judge_work() + rounds_; }
  /// Returns the work of one judgement.
  static Work judge_work() { return Work::other(work::kFilter); }

 private:
  const World& world_;
  const AdaptiveSampling& sampling_;
  const SamplePlan samples_;
  const bool smooth_;
  Work rounds_, next_, done_;
};

}  // namespace kiln::solver::adaptive
