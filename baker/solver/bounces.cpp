#include "baker/solver/bounces.h"

#include <vector>

namespace kiln::solver {

bool is_last_bounce(std::span<const double> changes, std::uint32_t limit, double tolerance) {
  if (changes.size() + 1 >= limit) return true;
  if (changes.size() < 2) return false;
  const double last = changes.back(), before = changes[changes.size() - 2];
  const double ratio = before > 0 ? last / before : 0;
  return ratio < 1 && last * ratio * ratio <= tolerance;
}

std::optional<BouncePasses::Next> BouncePasses::next(
    std::span<const proto::PassReport> done) const {
  const auto count = std::uint32_t(done.size());
  if (count < first_bounce())
    return Next{count == 0 ? Kind::kDirect : Kind::kSky, count + 1 == most()};
  if (count >= most()) return std::nullopt;
  std::vector<double> changes;
  for (const proto::PassReport& bounce : done.subspan(first_bounce()))
    changes.push_back(bounce.residual);
  const auto is_last = [&](std::size_t before) {
    return is_last_bounce(std::span(changes).first(before), bounces(),
                          double(world_.settings.tolerance));
  };
  if (!changes.empty() && is_last(changes.size() - 1)) return std::nullopt;
  return Next{Kind::kBounce, is_last(changes.size())};
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
