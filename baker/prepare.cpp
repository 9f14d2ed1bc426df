#include "baker/prepare.h"

#include <utility>

#include "baker/exec/workers.h"
#include "baker/import/import.h"
#include "baker/methods.h"
#include "baker/solver/direct/direct.h"
#include "baker/solver/pairwise/pairwise.h"

namespace kiln::baker {

proto::Expected<std::unique_ptr<PreparedBake>> prepare(UploadReader& source,
                                                       const proto::BakeSettings& settings,
                                                       exec::ThreadPool& pool, std::stop_token stop,
                                                       const PrepareHooks& hooks) {
  auto bake = std::make_unique<PreparedBake>();
  const auto enter = [&](const char* stage) {
    if (hooks.on_stage) hooks.on_stage(stage);
  };

  enter("import");
  auto scene = source.import(stop);
  if (!scene) return proto::Unexpected(scene.error());
  bake->scene = std::move(*scene);
  if (auto ok = import::apply_settings(bake->scene, settings, stop); !ok)
    return proto::Unexpected(ok.error());
  if (hooks.on_scene)
    if (auto ok = hooks.on_scene(bake->scene); !ok) return proto::Unexpected(ok.error());

  enter("atlas");
  auto atlas = atlas::build_atlas(bake->scene, settings.atlas, stop);
  if (!atlas) return proto::Unexpected(atlas.error());
  bake->atlas.emplace(std::move(*atlas));
  auto texels = rasterize(bake->scene, *bake->atlas, stop, atlas::kMaxBandPieces, &pool);
  if (!texels) return proto::Unexpected(texels.error());
  bake->texels = std::make_shared<const atlas::TextureGroup>(std::move(*texels));
  proto::SolverSettings costs = settings.solver;
  costs.window = solver::pairwise::window_texels(settings.solver, settings.atlas.page_size);
  if (auto ok = check_cost(costs, bake->texels->size()); !ok) return proto::Unexpected(ok.error());

  enter("solve");
  const exec::Workers workers{pool, stop};
  bake->lights.emplace(bake->scene, &workers,
                       settings.solver.emitters == proto::Emitters::kExplicit);
  if (stop.stop_requested()) return proto::canceled();
  auto rays = trace::RayScene::build(bake->scene, stop);
  if (!rays) return proto::Unexpected(rays.error());
  bake->rays.emplace(std::move(*rays));
  bake->lookup.emplace(bake->scene, *bake->atlas, *bake->texels);
  const bool many_lights = solver::direct::DirectLight::are_many(*bake->lights);
  bake->world.emplace(solver::World{bake->scene, *bake->atlas, *bake->texels, *bake->rays,
                                    *bake->lights, *bake->lookup, settings.solver,
                                    sample_plan(settings.solver, settings.quality, many_lights),
                                    settings.post.filter});
  return bake;
}

}  // namespace kiln::baker
