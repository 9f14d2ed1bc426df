#include "baker/solver/bounces.h"

namespace kiln::solver {

bool is_last_bounce(const proto::SolverSettings& settings,
                    std::span<const proto::PassReport> bounces) {
  if (bounces.size() + 1 >= settings.bounces) return true;
  if (bounces.size() < 2) return false;
  const double last = bounces.back().residual, before = bounces[bounces.size() - 2].residual;
  const double ratio = before > 0 ? last / before : 0;
  return ratio < 1 && last * ratio * ratio <= double(settings.tolerance);
}

std::optional<BouncePasses::Next> BouncePasses::next(
    std::span<const proto::PassReport> done) const {
  const auto count = std::uint32_t(done.size());
  if (count < first_bounce())
    return Next{count == 0 ? Kind::kDirect : Kind::kSky, count + 1 == most()};
  if (count >= most()) return std::nullopt;
  const auto bounces = done.subspan(first_bounce());
  if (!bounces.empty() && is_last_bounce(world_.settings, bounces.first(bounces.size() - 1)))
    return std::nullopt;
  return Next{Kind::kBounce, is_last_bounce(world_.settings, bounces)};
}

const char* to_string(BouncePasses::Kind kind) {
  switch (kind) {
    case BouncePasses::Kind::kDirect:
      return "direct";
    case BouncePasses::Kind::kSky:
      return "sky";
    default:
      return "bounce";
  }
}

}  // namespace kiln::solver
