#pragma once

#include <cstdint>
#include <span>

#include "baker/atlas/clip.h"
#include "baker/atlas/texture_group.h"
#include "baker/atlas/triangle_setup.h"

namespace kiln::atlas {

/// Places kPointsPerTexel points over the fragments of texel (x, y), stratified by area on the page
/// (which is area in the world within a chart, as far as its map keeps areas). Their order is
/// progressive: each aligned run of 4 is itself stratified. The pattern is scrambled by (page, x,
/// y), so that neighbors' errors are independent. Requires at least one fragment, each of positive
/// area.
void place_points(SetupCache&, std::uint32_t page, std::uint32_t x, std::uint32_t y,
                  std::span<const Fragment>, std::span<SamplePoint> points);

/// Rounds a point to the storage grid without leaving the triangle.
SamplePoint make_point(std::uint32_t triangle, Point bary);

}  // namespace kiln::atlas
