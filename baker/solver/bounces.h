#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "baker/solver/emittance.h"
#include "baker/solver/world.h"
#include "proto/manifest.h"

namespace kiln::solver {

/// Returns whether the bounce that follows is the last one: the limit is reached, or the one after
/// it would change the light by less than the tolerance, as the ratio of the last two says.
/// @param changes what each bounce so far has changed of the light, relative
bool is_last_bounce(std::span<const double> changes, std::uint32_t limit, double tolerance);

/// Decides the passes of a method that finds direct light first, then the sky's where there is one,
/// and then all indirect light anew in each bounce, from the light of the pass before.
class BouncePasses {
 public:
  enum class Kind { kDirect, kSky, kBounce };
  struct Next {
    Kind kind = Kind::kDirect;
    bool completes = false;  ///< no pass follows
  };

  /// @param world outlives this
  explicit BouncePasses(const World& world) : world_(world) {}

  /// Returns the number of passes before the first bounce.
  std::uint32_t first_bounce() const { return world_.scene.has_sky() ? 2 : 1; }
  /// Returns the most bounces.
  std::uint32_t bounces() const { return bounce_limit(world_.settings); }
  std::uint32_t most() const { return first_bounce() + bounces(); }
  std::optional<Next> next(std::span<const proto::PassReport> done) const;

 private:
  const World& world_;
};

const char* to_string(BouncePasses::Kind);

}  // namespace kiln::solver
