#include "baker/made_layers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/output/layers.h"
#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pairwise/sender_planes.h"
#include "baker/trace/voxel_grid.h"

namespace kiln::baker {
namespace {

using math::Rgb;
using output::TexelValue;
using proto::Expected;
using proto::Unexpected;

/// Holds what layers are made from.
struct Made {
  const PreparedBake& bake;
  const Solution& solution;
  const output::Reference& reference;
  const std::stop_token& stop;

  const solver::World& world() const { return *bake.world; }
};

/// Returns a layer of values that were made, or that the making was stopped.
template <class T, class Color>
Expected<TexelValue> layer_of(std::optional<std::vector<T>> values, const Color& color) {
  if (!values) return exec::canceled();
  auto kept = std::make_shared<const std::vector<T>>(std::move(*values));
  return TexelValue([kept, color](std::uint32_t t) { return color((*kept)[t]); });
}
Rgb gray(float v) {
  return {v, v, v};
}

/// Returns the radiosity of the light as it is shown.
auto shown_radiosity(const Made& of) {
  return solver::pairwise::texel_radiosity(
      of.world(), [&](std::uint32_t t) { return of.solution.irradiance(t); }, of.stop);
}

Expected<TexelValue> mip(const Made& of) {
  const auto radiosity = shown_radiosity(of);
  if (!radiosity) return exec::canceled();
  return layer_of(solver::pairwise::window_means(of.world(), *radiosity, of.stop),
                  [](Rgb b) { return b; });
}

Expected<TexelValue> tree(const Made& of) {
  const auto radiosity = shown_radiosity(of);
  if (!radiosity) return exec::canceled();
  return layer_of(solver::pairwise::leaf_sides(of.world(), *radiosity, of.stop),
                  [](std::uint8_t side) { return gray(side); });
}

Expected<TexelValue> senders(const Made& of) {
  const lightmap::Lightmap& light = *of.solution.light;
  const auto radiosity = solver::pairwise::texel_radiosity(
      of.world(), [&](std::uint32_t t) { return light.direct[t] + light.sky[t]; }, of.stop);
  if (!radiosity) return exec::canceled();
  return layer_of(solver::pairwise::sent_areas(of.world(), *radiosity, of.stop), gray);
}

/// Returns another number for a number, so that rows and layers of voxels, whose numbers advance by
/// a constant, get no hues that do.
std::uint32_t shuffled(std::uint32_t number) {
  number *= 0x9e3779b1u;
  number ^= number >> 15;
  number *= 0x85ebca6bu;
  return number >> 8;
}

Expected<TexelValue> voxels(const Made& of) {
  const proto::SolverSettings& settings = of.world().settings;
  auto grid = trace::VoxelGrid::build(of.bake.scene, settings.voxel_grid,
                                      solver::pairwise::Parts::voxel_fill(settings), of.stop);
  if (!grid) return Unexpected(grid.error());
  auto kept = std::make_shared<const trace::VoxelGrid>(std::move(*grid));
  return TexelValue([kept, texels = of.bake.texels](std::uint32_t t) {
    const std::uint32_t voxel = kept->voxel_of(texels->position[t]);
    return kept->is_solid_voxel(voxel) ? output::color_of(shuffled(voxel)) : Rgb{};
  });
}

Expected<TexelValue> error(const Made& of) {
  const atlas::TextureGroup& texels = *of.bake.texels;
  std::vector<Rgb> errors(texels.front_count);
  exec::StopPoll stopped(of.stop);
  for (std::uint32_t p = 0; of.reference.page && p < texels.pages.size(); ++p) {
    if (of.stop.stop_requested()) return exec::canceled();
    const auto page = of.reference.page(p);
    if (!page) return Unexpected(page.error());
    const std::vector<std::int32_t>& texel_at = texels.pages[p].texel_at;
    for (std::size_t i = 0; i < texel_at.size(); ++i) {
      if (stopped()) return exec::canceled();
      if (texel_at[i] < 0 || !(page->coverage[i] > 0)) continue;
      const Rgb off = of.solution.irradiance(std::uint32_t(texel_at[i])) - page->rgb[i];
      errors[std::size_t(texel_at[i])] = {std::abs(off.r), std::abs(off.g), std::abs(off.b)};
    }
  }
  return layer_of(std::optional(std::move(errors)), [](Rgb e) { return e; });
}

struct Maker {
  std::string_view layer;
  Expected<TexelValue> (*make)(const Made&);
};
constexpr std::array kMakers{Maker{"mip", mip}, Maker{"tree", tree}, Maker{"senders", senders},
                             Maker{"voxels", voxels}, Maker{"error", error}};

bool has(const proto::BakeSettings& settings, std::string_view layer) {
  return std::ranges::find(settings.output.layers, layer) != settings.output.layers.end();
}

}  // namespace

Expected<std::map<std::string, TexelValue>> make_layers(const PreparedBake& bake,
                                                        const proto::BakeSettings& settings,
                                                        const Solution& solution,
                                                        const output::Reference& reference,
                                                        const std::stop_token& stop) {
  std::map<std::string, TexelValue> out;
  for (const Maker& maker : kMakers) {
    if (!has(settings, maker.layer)) continue;
    auto value = maker.make({bake, solution, reference, stop});
    if (!value) return Unexpected(value.error());
    out[std::string(maker.layer)] = std::move(*value);
  }
  return out;
}

LayerMemory layer_memory(const proto::BakeSettings& settings, double texels) {
  using namespace solver::pairwise;
  LayerMemory out;
  const auto add = [&](std::string_view layer, double making, double kept) {
    if (!has(settings, layer)) return;
    out.making = std::max(out.making, making - kept);
    out.kept += kept;
  };
  add("mip", window_means_memory(texels), texels * sizeof(Rgb));
  add("tree", leaf_sides_memory(texels, settings.solver), texels * sizeof(std::uint8_t));
  add("senders", sent_areas_memory(texels, settings.solver), texels * sizeof(float));
  const double grid = trace::VoxelGrid::memory(settings.solver.voxel_grid);
  add("voxels", grid, grid);
  add("error", texels * sizeof(Rgb), texels * sizeof(Rgb));
  return out;
}

}  // namespace kiln::baker
