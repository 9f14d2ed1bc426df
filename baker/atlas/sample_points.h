#pragma once

#include <cstdint>
#include <span>

#include "baker/atlas/clip.h"
#include "baker/atlas/texture_group.h"
#include "baker/atlas/triangle_setup.h"

namespace kiln::atlas {

/// What one triangle covers of one texel.
struct Piece {
  std::uint32_t triangle = 0;
  double area = 0;  ///< texels^2
};

/// Places kPointsPerTexel points over the pieces of texel (x, y), stratified by area on the page
/// (which is area in the world within a chart, as far as its map keeps areas). Their order is
/// progressive: each aligned run of 4 is itself stratified. The pattern is scrambled by
/// (page, x, y), so that neighbours' errors are independent.
/// Requires at least one piece, each of positive area.
void place_points(SetupCache&, std::uint32_t page, std::uint32_t x, std::uint32_t y,
                  std::span<const Piece>, std::span<SamplePoint> points);

/// Rounds to the storage grid without leaving the triangle.
SamplePoint make_point(std::uint32_t triangle, Point bary);

}  // namespace kiln::atlas
