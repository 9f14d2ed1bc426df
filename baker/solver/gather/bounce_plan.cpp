#include "baker/solver/gather/bounce_plan.h"

#include <cmath>

namespace kiln::solver::gather {
namespace {

constexpr std::uint32_t kPacket = 16;
/// A bounce that brings no more than this share of the light reads half of the hits, one that
/// brings half as much a quarter, and so on: on a Cornell box that raises the error by 1 %, and
/// leaves a third of the look-ups.
constexpr double kSmallShare = 0.125;

/// Returns the mean change of the light by a pass, lx.
double update(const proto::PassReport& pass) {
  return pass.residual * pass.mean_lx;
}

}  // namespace

std::uint32_t BouncePlan::directions_for(double share) const {
  std::uint32_t n = set_.size();
  if (set_.coherent) return n;
  while (n % (2 * kPacket) == 0 && share <= kSmallShare) n /= 2, share *= 2;
  return n;
}

BouncePlan::Bounce BouncePlan::next(std::span<const proto::PassReport> done) const {
  const auto bounces = std::uint32_t(done.size()) - first_;
  Bounce bounce;
  bounce.last = bounces + 1 == limit_;
  double share = 1;  // share of what is reflected, in what the first bounce reflects
  if (bounces > 0) {
    const double ratio = bounces > 1 ? update(done.back()) / update(done[done.size() - 2]) : 0;
    if (!bounce.last) end_if_converged(done.back().residual, ratio, limit_ - bounces, bounce);
    share = (1 + bounce.tail_scale) * update(done.back()) / done[lit_ - 1].mean_lx;
  }
  bounce.directions = directions_for(share);
  return bounce;
}

/// Makes the bounce the last one if it, and all that would follow, changes less than the
/// tolerance: it stands for all that are left out then, by the ratio of the last two updates.
/// @param left bounces, this one counted
void BouncePlan::end_if_converged(double residual, double ratio, std::uint32_t left,
                                  Bounce& bounce) const {
  if (!(ratio > 0) || !(ratio < 1)) ratio = 0;
  if ((ratio > 0 ? residual * ratio : residual) > tolerance_) return;
  bounce.last = bounce.stands_for_others = true;
  bounce.tail_scale = ratio * (1 - std::pow(ratio, left - 1)) / (1 - ratio);
}

}  // namespace kiln::solver::gather
