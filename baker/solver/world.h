#pragma once

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/light/light_set.h"
#include "baker/scene/scene.h"
#include "baker/solver/sample_plan.h"
#include "baker/trace/ray_scene.h"
#include "baker/trace/texel_surface.h"
#include "proto/bake_settings.h"

namespace kiln::solver {

/// Holds all that a method reads: the scene, made ready, and how it is to be lit. The settings and
/// the plan of samples are part of it, since all sampling needs the seed and the techniques.
/// Immutable; outlives the solvers and passes that are made from it. Any process that prepares the
/// same bake has the same world.
struct World {
  const scene::Scene& scene;
  const atlas::Atlas& atlas;
  const atlas::TextureGroup& texels;
  const trace::RayScene& rays;
  const light::LightSet& lights;
  const trace::TexelLookup& lookup;
  proto::SolverSettings settings;
  SamplePlan plan;
  bool filter = true;  ///< the settings ask for smooth light
};

}  // namespace kiln::solver
