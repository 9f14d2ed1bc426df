#include "baker/solver/gather/packet_layout.h"

#include <algorithm>
#include <bit>

#include "baker/solver/solver.h"

namespace kiln::solver::gather {
namespace {

/// From this many samples on, sixteen neighbouring strata make a narrow cone of rays.
constexpr std::uint32_t kCoherentSamples = 256;
/// Triangles for a texel up to which rays that leave neighbouring texels alike meet the same ones,
/// and up to which those of a narrow cone do. Measured, see docs/performance.md.
constexpr double kTileTriangles = 0.5, kConeTriangles = 1;

proto::RayPattern choose(const SolverInput& in, std::uint32_t directions) {
  if (in.settings.ray_pattern != proto::RayPattern::kAuto) return in.settings.ray_pattern;
  const double triangles = double(in.scene.triangles.size()) / std::max(1u, in.texels.size());
  if (triangles <= kTileTriangles) return proto::RayPattern::kTile;
  return directions >= kCoherentSamples && triangles <= kConeTriangles
             ? proto::RayPattern::kStrata
             : proto::RayPattern::kIncoherent;
}

}  // namespace

PacketPlan::PacketPlan(const SolverInput& in, std::uint32_t directions)
    : pattern_(choose(in, directions)) {
  if (texels() == 1) return;
  const int bits = std::bit_width(directions) - 2;
  const auto upper = [](int n) { return n > 0 ? ~0u << (32 - n) : 0; };
  shared_x_ = upper((bits + 1) / 2);
  shared_y_ = upper(bits / 2);
}

const char* PacketPlan::name() const {
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

std::uint32_t PacketPlan::texels() const {
  switch (pattern_) {
    case proto::RayPattern::kTile:
      return 16;
    case proto::RayPattern::kBlock:
      return 4;
    default:
      return 1;
  }
}

bool PacketPlan::sorts_directions() const {
  return pattern_ == proto::RayPattern::kStrata || pattern_ == proto::RayPattern::kBlock;
}

}  // namespace kiln::solver::gather
