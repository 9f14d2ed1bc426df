#include "baker/solver/gather/packet_layout.h"

#include <algorithm>
#include <bit>

#include "baker/sampling/direction_set.h"
#include "baker/solver/world.h"

namespace kiln::solver::gather {
namespace {

/// The numbers of triangles for a texel up to which rays that leave neighboring texels alike meet
/// the same ones, and up to which those of a narrow cone do. Measured, see docs/performance.md.
constexpr double kTileTriangles = 0.5, kConeTriangles = 1;

proto::RayPattern choose(const World& world, std::uint32_t directions) {
  if (world.settings.ray_pattern != proto::RayPattern::kAuto) return world.settings.ray_pattern;
  const double triangles = double(world.scene.triangles.size()) / std::max(1u, world.texels.size());
  if (triangles <= kTileTriangles) return proto::RayPattern::kTile;
  return directions >= sampling::DirectionSet::kCoherentSamples && triangles <= kConeTriangles
             ? proto::RayPattern::kStrata
             : proto::RayPattern::kIncoherent;
}

}  // namespace

PacketLayout::PacketLayout(const World& world, std::uint32_t directions)
    : pattern_(choose(world, directions)) {
  if (texels() == 1) return;
  const int bits = std::bit_width(directions) - 2;
  const auto upper = [](int n) { return n > 0 ? ~0u << (32 - n) : 0; };
  shared_x_ = upper((bits + 1) / 2);
  shared_y_ = upper(bits / 2);
}

const char* PacketLayout::name() const {
  switch (pattern_) {
    case proto::RayPattern::kTile:
      return "tile";
    case proto::RayPattern::kBlock:
      return "block";
    case proto::RayPattern::kStrata:
      return "strata";
    default:
      return "incoherent";
  }
}

std::uint32_t PacketLayout::texels() const {
  switch (pattern_) {
    case proto::RayPattern::kTile:
      return 16;
    case proto::RayPattern::kBlock:
      return 4;
    default:
      return 1;
  }
}

bool PacketLayout::sorts_directions() const {
  return pattern_ == proto::RayPattern::kStrata || pattern_ == proto::RayPattern::kBlock;
}

}  // namespace kiln::solver::gather
