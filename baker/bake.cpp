#include "baker/bake.h"

#include <chrono>
#include <cstdio>
#include <future>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "baker/checkpoint/checkpoints.h"
#include "baker/image/image.h"
#include "baker/made_layers.h"
#include "baker/methods.h"
#include "baker/output/output.h"
#include "baker/preflight.h"
#include "baker/prepare.h"
#include "baker/progress/reporter.h"
#include "baker/reference.h"
#include "baker/simd/kernels.h"
#include "baker/solve.h"
#include "baker/solve_session.h"
#include "proto/json.h"
#include "proto/settings_schema.h"
#include "proto/sha256.h"

namespace kiln::baker {
namespace {

using proto::Expected;
using proto::Unexpected;

void count_scene(const scene::Scene& scene, proto::Statistics& s) {
  s.triangles = scene.triangles.size();
  s.instances = scene.instances.size();
  s.punctual_lights = scene.lights.size();
  for (std::uint32_t t = 0; t < s.triangles; ++t) s.emissive_triangles += is_emissive(scene, t);
}

void count_texels(const atlas::Atlas& atlas, const atlas::TextureGroup& texels,
                  proto::Statistics& s) {
  s.texels = texels.size();
  s.charts = atlas.charts.size();
  s.texels_per_metre = atlas.texels_per_metre;
  s.albedo_capped_texels = texels.albedo_capped;
}

void count_light(const Solution& solution, proto::Statistics& s) {
  s.passes = solution.passes;
  s.tail_scale = solution.tail_scale;
  s.ray_pattern = solution.ray_pattern;
  for (const auto& p : solution.passes) {
    s.rays += p.rays;
    if (p.standard_error) s.standard_error = p.standard_error;
  }
  for (const float v : solution.light->validity) s.invalid_texels += v < lightmap::kValidShare;
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g %%", 100 * share);
  return text;
}

/// @param target_error 0: none
void warn_of_texels(const proto::Statistics& s, double target_error,
                    std::vector<proto::Warning>& warnings) {
  if (s.albedo_capped_texels > 0)
    warnings.push_back({"albedo_capped", "",
                        std::to_string(s.albedo_capped_texels) + " of " + std::to_string(s.texels) +
                            " texels had an albedo above 0.98, which was lowered to 0.98 so that "
                            "the light between surfaces converges."});
  if (s.standard_error && target_error > 0 && *s.standard_error > target_error)
    warnings.push_back({"target_error_missed", "",
                        "The standard error is " + percent(*s.standard_error) + ", not the " +
                            percent(target_error) +
                            " that were asked for: quality.max_samples is reached, or what is left "
                            "can't be lowered by samples."});
  if (s.invalid_texels > 0)
    warnings.push_back({"texels_inside_geometry", "",
                        std::to_string(s.invalid_texels) + " of " + std::to_string(s.texels) +
                            " texels see mostly the backs of surfaces: they lie inside or behind "
                            "other geometry, and are dark."});
}

progress::ProgressReporter::Listener progress_listener(BakeObserver& observer) {
  return {[&](const std::string& stage) { observer.on_stage(stage); },
          [&](const proto::JobProgress& p) { observer.on_progress(p); }};
}

/// These return options and listener for the checkpoints of a bake.
checkpoint::CheckpointWriter::Options checkpoint_options(const BakeInput& input, unsigned threads,
                                                         std::stop_token stop) {
  checkpoint::CheckpointWriter::Options options;
  options.dir = input.checkpoint_dir;
  if (!options.dir.empty()) options.key = bake_key(input.scene_key, input.settings);
  options.share = input.checkpoint_share;
  options.threads = threads;
  options.stop = std::move(stop);
  return options;
}
checkpoint::Checkpoints::Listener checkpoint_listener(BakeObserver& observer) {
  return {[&](const proto::PassReport& pass) { observer.on_pass(pass); },
          [&](const proto::Warning& warning) { observer.on_warning(warning); }};
}

/// Puts the scene into the manifest and asks for the memory that the bake may take.
Expected<void> announce_scene(const BakeInput& input, const scene::Scene& scene,
                              proto::Manifest& manifest, const std::stop_token& stop,
                              BakeObserver& observer) {
  manifest.warnings = proto::settings_without_effect(input.settings);
  manifest.warnings.insert(manifest.warnings.end(), scene.warnings.begin(), scene.warnings.end());
  for (const auto& w : manifest.warnings) observer.on_warning(w);
  count_scene(scene, manifest.statistics);
  const std::uint64_t memory = estimate_memory(scene, input.settings);
  manifest.statistics.memory_estimate_bytes = memory;
  if (!input.reserve_memory) return {};
  return input.reserve_memory(memory, stop);
}

/// Share of the whole bake that is over when a stage begins.
double fraction_at(std::string_view stage) {
  if (stage == "atlas") return kImportedAt;
  return stage == "solve" ? kSolvingFrom : 0;
}

std::shared_ptr<UploadReader> source_of(const BakeInput& input) {
  if (input.source) return input.source;
  files::SceneFiles files = input.files;
  files.sky_map = input.settings.sky.map;
  return std::make_shared<InProcessReader>(std::move(files), input.limits);
}

}  // namespace

const char* instruction_set() {
  return simd::kernels().name;
}

std::string bake_key(const std::string& scene_key, const proto::BakeSettings& settings) {
  return proto::sha256_hex(LIGHTKILN_VERSION "\n" + std::string(instruction_set()) + "\n" +
                           scene_key + "\n" + proto::to_text(proto::to_json(settings)));
}

proto::Expected<proto::Manifest> bake(const BakeInput& input, exec::ThreadPool& pool,
                                      std::stop_token stop, BakeObserver& observer) {
  proto::Manifest manifest;
  manifest.version = LIGHTKILN_VERSION;
  manifest.scene_sha256 = input.scene_sha256;
  manifest.instruction_set = instruction_set();
  manifest.settings = input.settings;
  progress::ProgressReporter reporter(progress_listener(observer), manifest.statistics.stages);

  // Loading takes a fifth of a second, which passes beside other work.
  std::future<Expected<void>> images;
  if (!input.settings.output.formats.empty())
    images = std::async(std::launch::async, image::open_module);

  // 1. Make all that a method reads of the files.
  const auto source = source_of(input);
  const PrepareHooks hooks{[&](const char* stage) { reporter.enter(stage, fraction_at(stage)); },
                           [&](const scene::Scene& scene) {
                             return announce_scene(input, scene, manifest, stop, observer);
                           }};
  const auto prepared = prepare(*source, input.settings, pool, stop, hooks);
  if (!prepared) return Unexpected(prepared.error());
  const PreparedBake& bake = **prepared;
  count_texels(*bake.atlas, *bake.texels, manifest.statistics);

  // A missing image module is reported now rather than after hours. A bake that gets here before
  // the module is open learns of it at its end.
  if (images.valid() && images.wait_for(std::chrono::seconds(0)) == std::future_status::ready)
    if (auto ok = image::open_module(); !ok) return Unexpected(ok.error());

  const auto reference = ReferenceBake::check(input, bake, stop);
  if (!reference) return Unexpected(reference.error());

  // 2. Run the passes, from where an earlier attempt ended.
  checkpoint::Checkpoints checkpoints(checkpoint_options(input, pool.size(), stop),
                                      checkpoint_listener(observer));
  const auto solver = make_solver(*bake.world);
  solver::SolveStart start = checkpoints.find(*solver, bake.texels->size());
  SolveSession session(input, *bake.world, *solver, bake.texels, start, checkpoints.writer(),
                       observer, reporter, reference->work());
  const auto solution = solve(*bake.world, *solver, pool, stop, session.hooks(), std::move(start));
  if (!solution) return Unexpected(solution.error());
  checkpoints.writer().write_now();  // while the files are written
  count_light(*solution, manifest.statistics);
  const std::size_t reported = manifest.warnings.size();
  warn_of_texels(manifest.statistics, double(bake.world->plan.target_error), manifest.warnings);
  for (proto::Warning& remark : solver->remarks(solution->passes, *solution->light))
    manifest.warnings.push_back(std::move(remark));

  // 3. Make what the result is compared with.
  if (reference->wanted()) reporter.enter("reference", 0);
  auto compared = reference->make(pool, stop, session.reference_hooks());
  if (!compared) return Unexpected(compared.error());
  if (reference->wanted() && !compared->page)
    manifest.warnings.push_back({"report_left_out", "",
                                 "The bake was ended early, so its result is not compared with "
                                 "what report.against names, and a layer `error` is black."});

  // 4. Write the files.
  reporter.enter("output", kSolvedAt);
  const output::LitWriter write_lit = [&](const auto& path, const auto& pages,
                                          std::stop_token until) {
    return source->write_lit(path, bake.scene, *bake.atlas, pages, std::move(until));
  };
  auto made = make_layers(bake, input.settings, *solution, *compared, stop);
  if (!made) return Unexpected(made.error());
  const output::OutputInput output{
      write_lit,        bake.scene,         *bake.atlas,          *bake.texels,
      *solution->light, solution->filtered, std::move(*compared), std::move(*made)};
  if (auto ok = write_outputs(input.output_dir, output, input.settings, manifest, pool, stop); !ok)
    return Unexpected(ok.error());
  if (!checkpoints.writer().flush()) return proto::canceled();
  for (std::size_t i = reported; i < manifest.warnings.size(); ++i)
    observer.on_warning(manifest.warnings[i]);
  reporter.leave();
  return manifest;
}

}  // namespace kiln::baker
