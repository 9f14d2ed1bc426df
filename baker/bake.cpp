#include "baker/bake.h"

#include <atomic>
#include <chrono>
#include <cstdio>
#include <future>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "baker/atlas/atlas.h"
#include "baker/checkpoint/checkpoint.h"
#include "baker/checkpoint/checkpoint_writer.h"
#include "baker/image/image.h"
#include "baker/methods.h"
#include "baker/output/output.h"
#include "baker/preflight.h"
#include "baker/progress/eta.h"
#include "baker/simd/kernels.h"
#include "baker/solver/direct/direct.h"
#include "baker/solver/solve.h"
#include "baker/solver/work.h"
#include "proto/json.h"
#include "proto/sha256.h"

namespace kiln::baker {
namespace {

using Clock = std::chrono::steady_clock;
using proto::Expected;
using proto::Unexpected;

/// Shares of a bake's time, for the progress bar: what comes before and after the solver.
constexpr double kImportedAt = 0.05, kSolvingFrom = 0.15, kSolvedAt = 0.92;
constexpr auto kProgressInterval = std::chrono::milliseconds(50);
/// Below this share of rays without a back face behind them a texel counts as inside something.
constexpr float kValidShare = 0.5f;

/// Reports to the observer: stages with their times, and progress at a bounded rate.
class Course {
 public:
  Course(BakeObserver& observer, proto::Statistics& statistics)
      : observer_(observer), statistics_(statistics) {}

  void enter(const char* stage, double fraction) {
    leave();
    stage_ = stage;
    start_ = Clock::now();
    observer_.on_stage(stage);
    proto::JobProgress p;
    p.stage = stage_;
    p.fraction = risen_to(fraction);
    observer_.on_progress(p);
  }
  void leave() {
    if (stage_.empty()) return;
    statistics_.stages.push_back(
        {stage_, std::chrono::duration<double>(Clock::now() - start_).count()});
    stage_.clear();
  }
  /// From any thread.
  void batch(const solver::Pass& pass, std::uint32_t done, std::uint32_t total,
             std::uint32_t max_passes, double residual, double fraction,
             std::optional<double> eta_seconds) {
    const auto now = Clock::now().time_since_epoch().count();
    auto due = due_.load(std::memory_order_relaxed);
    if (done < total && now < due) return;
    const auto next = now + std::chrono::duration_cast<Clock::duration>(kProgressInterval).count();
    if (!due_.compare_exchange_strong(due, next) && done < total) return;
    proto::JobProgress p;
    p.stage = stage_;
    p.pass = pass.index;
    p.max_passes = max_passes;
    p.batches_done = done;
    p.batches_total = total;
    p.residual = residual;
    p.fraction = risen_to(fraction);
    p.eta_seconds = eta_seconds;
    observer_.on_progress(p);
  }

 private:
  /// The work ahead is known better with every pass, but what was told is not taken back.
  double risen_to(double fraction) {
    double before = fraction_.load(std::memory_order_relaxed);
    while (before < fraction && !fraction_.compare_exchange_weak(before, fraction)) {
    }
    return std::max(before, fraction);
  }

  BakeObserver& observer_;
  proto::Statistics& statistics_;
  std::string stage_;
  std::atomic<double> fraction_{0};
  Clock::time_point start_;
  std::atomic<Clock::rep> due_{0};
};

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

void count_light(const solver::Solution& solution, proto::Statistics& s) {
  s.passes = solution.passes;
  s.tail_scale = solution.tail_scale;
  s.ray_pattern = solution.ray_pattern;
  for (const auto& p : solution.passes) {
    s.rays += p.rays;
    if (p.standard_error) s.standard_error = p.standard_error;
  }
  for (const float v : solution.light->validity) s.invalid_texels += v < kValidShare;
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

/// The checkpoints of one bake: what it finds, and what it leaves.
class Checkpoints {
 public:
  Checkpoints(const BakeInput& input, unsigned threads, std::stop_token stop,
              BakeObserver& observer)
      : observer_(observer) {
    options_.dir = input.checkpoint_dir;
    if (!options_.dir.empty()) options_.key = bake_key(input.scene_key, input.settings);
    options_.share = input.checkpoint_share;
    options_.threads = threads;
    options_.stop = std::move(stop);
  }

  solver::SolveStart find(solver::Solver& solver, std::uint32_t texels) {
    solver::SolveStart start = read(solver, texels);
    const checkpoint::CheckpointWriter::Listener listener{
        [this](const proto::PassReport& pass) { observer_.on_pass(pass); },
        [this](const proto::Error& error) {
          observer_.on_warning(
              {"checkpoint_failed", "", error.message + " The bake goes on without checkpoints."});
        }};
    writer_.emplace(options_, listener, start.passes.size());
    return start;
  }
  checkpoint::CheckpointWriter& writer() { return *writer_; }

 private:
  solver::SolveStart read(solver::Solver& solver, std::uint32_t texels) {
    if (options_.dir.empty()) return {};
    auto found =
        checkpoint::read_checkpoint(options_.dir, options_.key, solver, texels, options_.stop);
    if (options_.stop.stop_requested()) return {};  // the solve will say so
    if (found) return found->value_or(solver::SolveStart{});
    observer_.on_warning(
        {"checkpoint_ignored", "", found.error().message + " The bake starts at its first pass."});
    checkpoint::remove_checkpoints(options_.dir);
    return {};
  }

  checkpoint::CheckpointWriter::Options options_;
  BakeObserver& observer_;
  std::optional<checkpoint::CheckpointWriter> writer_;
};

/// What ends with a solver: nobody reads its state any more.
class StateReader {
 public:
  explicit StateReader(checkpoint::CheckpointWriter& writer) : writer_(writer) {}
  ~StateReader() { writer_.release_state(); }
  StateReader(const StateReader&) = delete;
  StateReader& operator=(const StateReader&) = delete;

 private:
  checkpoint::CheckpointWriter& writer_;
};

/// Expected effort of passes that are done.
solver::Work work_of(const solver::Solver& solver, std::span<const proto::PassReport> passes) {
  solver::Work work;
  for (std::size_t i = 0; i < passes.size(); ++i) {
    const auto pass = solver.next(passes.first(i));
    work += pass->work + pass->finish_work;
  }
  return work;
}

/// Tells of a solve while it runs, and keeps its passes.
class SolveTeller {
 public:
  SolveTeller(const BakeInput& input, solver::Solver& solver,
              std::shared_ptr<const atlas::TextureGroup> texels, const solver::SolveStart& start,
              checkpoint::CheckpointWriter& writer, BakeObserver& observer, Course& course)
      : input_(input),
        solver_(solver),
        texels_(std::move(texels)),
        writer_(writer),
        observer_(observer),
        course_(course),
        passes_(start.passes),
        pace_(work_of(solver, start.passes)) {
    for (const auto& p : passes_)
      if (p.residual > 0) residual_ = p.residual;
    if (passes_.empty()) return;
    observer_.on_resume(std::uint32_t(passes_.size()));
    observer_.on_snapshot({texels_, start.light, passes_.back().index});
  }

  /// Of use as long as this.
  solver::SolveHooks hooks() {
    solver::SolveHooks hooks;
    hooks.enough = input_.enough;
    hooks.part_time = input_.part_time;
    hooks.on_batch = [this](const solver::Pass& pass, std::uint32_t done, std::uint32_t total) {
      on_batch(pass, done, total);
    };
    hooks.on_pass = [this](
                        const solver::Pass& pass, const proto::PassReport& report,
                        std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
      on_pass(pass, report, std::move(light));
      return {};
    };
    hooks.before_pass = [this](const solver::Pass& pass) { writer_.before(pass); };
    hooks.on_part = [this](const solver::Pass& pass,
                           std::shared_ptr<const lightmap::Lightmap> before,
                           std::shared_ptr<const lightmap::Lightmap> after,
                           const solver::PassProgress& progress) {
      writer_.offer_part(pass, std::move(before), std::move(after), progress, solver_.state());
    };
    hooks.before_finish = [this] { writer_.release_part(); };
    hooks.restore = [this](const solver::Pass& pass, const lightmap::Lightmap& before,
                           lightmap::Lightmap& after) { return restore(pass, before, after); };
    return hooks;
  }

 private:
  void on_batch(const solver::Pass& pass, std::uint32_t done, std::uint32_t total) {
    const double share = solver_.work_share(pass, double(done) / total);
    const progress::Pace::Ahead ahead =
        pace_.ahead(pass, share, solver_.total_work() + solver::Work::other(solver::work::kOutput));
    course_.batch(pass, done, total, solver_.max_passes(), residual_,
                  kSolvingFrom + (kSolvedAt - kSolvingFrom) * ahead.share_done, ahead.seconds_left);
  }
  void on_pass(const solver::Pass& pass, const proto::PassReport& report,
               std::shared_ptr<const lightmap::Lightmap> light) {
    pace_.end_pass(pass);
    if (report.residual > 0) residual_ = report.residual;  // tracing alone changes no light
    passes_.push_back(report);
    observer_.on_snapshot({texels_, light, report.index});
    writer_.offer(pass, passes_, std::move(light), solver_.state());
  }
  solver::PassProgress restore(const solver::Pass& pass, const lightmap::Lightmap& before,
                               lightmap::Lightmap& after) {
    const solver::PassProgress done = writer_.restore(pass, before, after, solver_.state());
    if (done.texels == 0) return done;
    const double share = double(done.texels) / texels_->size();
    pace_.resume_within(solver_.work_share(pass, share));
    observer_.on_resume_within(pass.name, share);
    return done;
  }

  const BakeInput& input_;
  solver::Solver& solver_;
  const std::shared_ptr<const atlas::TextureGroup> texels_;
  checkpoint::CheckpointWriter& writer_;
  BakeObserver& observer_;
  Course& course_;
  std::vector<proto::PassReport> passes_;
  double residual_ = 1;
  progress::Pace pace_;
};

/// The solve stage: passes with checkpoints and snapshots.
Expected<solver::Solution> solve_texels(const BakeInput& input, const scene::Scene& scene,
                                        const atlas::Atlas& atlas,
                                        const std::shared_ptr<const atlas::TextureGroup>& texels,
                                        const light::LightSet& lights, exec::ThreadPool& pool,
                                        std::stop_token stop, BakeObserver& observer,
                                        Course& course, Checkpoints& checkpoints) {
  auto rays = trace::RayScene::build(scene, stop);
  if (!rays) return Unexpected(rays.error());
  const trace::TexelLookup lookup(scene, atlas, *texels);
  const solver::SolverInput solver_input{
      scene,
      atlas,
      *texels,
      *rays,
      lights,
      lookup,
      input.settings.solver,
      solver::sample_plan(input.settings.solver, input.settings.quality,
                          solver::direct::DirectLight::are_many(lights)),
      input.settings.post.filter};
  const auto solver = make_solver(solver_input);
  solver::SolveStart start = checkpoints.find(*solver, texels->size());
  checkpoint::CheckpointWriter& writer = checkpoints.writer();
  const StateReader reader(writer);
  SolveTeller teller(input, *solver, texels, start, writer, observer, course);
  auto solution = solve(*solver, *texels, pool, stop, teller.hooks(), std::move(start));
  writer.hurry();  // while the files are written
  return solution;
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
  Course course(observer, manifest.statistics);

  // Loading takes a third of a second, which passes beside other work.
  std::future<Expected<void>> images;
  if (!input.settings.output.formats.empty())
    images = std::async(std::launch::async, image::open_module);

  course.enter("import", 0);
  const auto source = source_of(input);
  auto scene = source->import(stop);
  if (!scene) return Unexpected(scene.error());
  if (auto ok = import::apply_settings(*scene, input.settings, stop); !ok)
    return Unexpected(ok.error());
  manifest.warnings = scene->warnings;
  for (const auto& w : scene->warnings) observer.on_warning(w);
  count_scene(*scene, manifest.statistics);
  const std::uint64_t memory = estimate_memory(*scene, input.settings);
  manifest.statistics.memory_estimate_bytes = memory;
  if (input.reserve_memory)
    if (auto ok = input.reserve_memory(memory, stop); !ok) return Unexpected(ok.error());

  course.enter("atlas", kImportedAt);
  const auto atlas = atlas::build_atlas(*scene, input.settings.atlas, stop);
  if (!atlas) return Unexpected(atlas.error());
  auto rasterised = rasterise(*scene, *atlas, stop, atlas::kMaxBandPieces, &pool);
  if (!rasterised) return Unexpected(rasterised.error());
  const auto texels = std::make_shared<const atlas::TextureGroup>(std::move(*rasterised));
  count_texels(*atlas, *texels, manifest.statistics);

  // Better now than after hours; a bake of less time than that learns it at its end.
  if (images.valid() && images.wait_for(std::chrono::seconds(0)) == std::future_status::ready)
    if (auto ok = images.get(); !ok) return Unexpected(ok.error());

  course.enter("solve", kSolvingFrom);
  Checkpoints checkpoints(input, pool.size(), stop, observer);
  const exec::Workers workers{pool, stop};
  const light::LightSet lights(*scene, &workers);
  if (stop.stop_requested()) return proto::fail(proto::kCanceledCode, "The job was canceled.");
  const auto solution = solve_texels(input, *scene, *atlas, texels, lights, pool, stop, observer,
                                     course, checkpoints);
  if (!solution) return Unexpected(solution.error());
  count_light(*solution, manifest.statistics);
  const std::size_t reported = manifest.warnings.size();
  const auto plan = solver::sample_plan(input.settings.solver, input.settings.quality);
  warn_of_texels(manifest.statistics, double(plan.target_error), manifest.warnings);

  course.enter("output", kSolvedAt);
  const output::LitWriter write_lit = [&](const auto& path, auto pages, std::stop_token until) {
    return source->write_lit(path, *scene, *atlas, pages, std::move(until));
  };
  const output::OutputInput output{write_lit, *scene,           *atlas,
                                   *texels,   *solution->light, solution->filtered};
  if (auto ok = write_outputs(input.output_dir, output, input.settings, manifest, pool, stop); !ok)
    return Unexpected(ok.error());
  if (!checkpoints.writer().flush())
    return proto::fail(proto::kCanceledCode, "The job was canceled.");
  for (std::size_t i = reported; i < manifest.warnings.size(); ++i)
    observer.on_warning(manifest.warnings[i]);
  course.leave();
  return manifest;
}

}  // namespace kiln::baker
