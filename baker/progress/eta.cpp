#include "baker/progress/eta.h"

#include <algorithm>

namespace kiln::progress {
namespace {

double seconds_between(EtaEstimator::Clock::time_point from, EtaEstimator::Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

double dot(const std::array<double, solver::Work::kKinds>& rates, const solver::Work& work) {
  double seconds = 0;
  for (std::size_t k = 0; k < solver::Work::kKinds; ++k) seconds += rates[k] * work.of[k];
  return seconds;
}

}  // namespace

/// Kinds of which nothing has been done yet go as fast as the others together.
EtaEstimator::Rates EtaEstimator::Timed::rates() const {
  double all_seconds = 0, all_work = 0;
  for (std::size_t k = 0; k < solver::Work::kKinds; ++k)
    all_seconds += seconds[k], all_work += work[k];
  const double common = all_work > 0 ? all_seconds / all_work : 1;
  Rates r;
  for (std::size_t k = 0; k < solver::Work::kKinds; ++k)
    r[k] = work[k] > 0 ? seconds[k] / work[k] : common;
  return r;
}

bool EtaEstimator::Timed::any() const {
  return std::any_of(work.begin(), work.end(), [](double w) { return w > 0; });
}

void EtaEstimator::Timed::add(const solver::Work& more, double its_seconds) {
  const Rates r = rates();
  const double expected = dot(r, more);
  if (!(expected > 0)) return;
  for (std::size_t k = 0; k < solver::Work::kKinds; ++k) {
    seconds[k] += its_seconds * r[k] * more.of[k] / expected;
    work[k] += more.of[k];
  }
}

EtaEstimator::Ahead EtaEstimator::ahead(const solver::PassPlan& pass, double share,
                                        const solver::Work& all, Clock::time_point now) const {
  constexpr double kLeastSeconds = 0.1;
  const solver::Work by_now = done_ + pass.work * share;
  solver::Work left;
  for (std::size_t k = 0; k < solver::Work::kKinds; ++k)
    left.of[k] = std::max(all.of[k] - by_now.of[k], 0.0);
  const double sum = by_now.sum() + left.sum();
  Ahead ahead;
  ahead.share_done = sum > 0 ? by_now.sum() / sum : 0;
  // The first batches of a pass say little of its rate: what came before them took time, too.
  constexpr double kMinTimedShare = 0.1;
  const double measured = std::max(share - restored_, 0.0);
  const double known = timed_.any() ? std::min(measured / kMinTimedShare, 1.0) : 1;
  const solver::Work fresh = pass.work * measured;
  const double seconds = seconds_between(pass_start_, now);
  Timed timed = timed_;
  timed.add(fresh, known * seconds + (1 - known) * dot(timed.rates(), fresh));
  if (timed.any() && seconds_between(start_, now) >= kLeastSeconds)
    ahead.seconds_left = dot(timed.rates(), left);
  return ahead;
}

void EtaEstimator::end_pass(const solver::PassPlan& pass, Clock::time_point now) {
  timed_.add(pass.work * (1 - restored_) + pass.finish_work, seconds_between(pass_start_, now));
  done_ += pass.work + pass.finish_work;
  restored_ = 0;
  pass_start_ = now;
}

}  // namespace kiln::progress
