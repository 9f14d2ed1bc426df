#include "baker/solver/solve.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <optional>

#include "baker/solver/gather.h"
#include "baker/solver/path.h"

namespace kiln::baker {
namespace {

/// From area-weighted sums over the texels, by runs of the same texels on any number of threads.
struct Change {
  double mean_lx = 0;   ///< E after
  double residual = 0;  ///< mean |E after - E before| over mean E after
  bool finite = true;
};

/// Nothing when stopped.
std::optional<Change> measure(const TextureGroup& texels, const Lightmap& before,
                              const Lightmap& after, const Workers& workers) {
  constexpr std::uint32_t kRunTexels = 16384;
  struct Sums {
    double area = 0, light = 0, moved = 0;
  };
  std::vector<Sums> runs(texels.size() / kRunTexels + 1);
  const bool whole = workers.for_runs(texels.size(), kRunTexels, [&](auto begin, auto end) {
    Sums& run = runs[begin / kRunTexels];
    for (std::uint32_t t = begin; t < end; ++t) {
      const double a = texels.area_m2[t];
      const Rgb now = after.irradiance(t), then = before.irradiance(t);
      run.area += a;
      run.light += a * (double(now.r) + now.g + now.b) / 3;
      run.moved += a *
                   (std::abs(double(now.r) - then.r) + std::abs(double(now.g) - then.g) +
                    std::abs(double(now.b) - then.b)) /
                   3;
    }
  });
  if (!whole) return std::nullopt;
  Sums all;
  for (const Sums& run : runs) all.area += run.area, all.light += run.light, all.moved += run.moved;
  Change c;
  c.finite = std::isfinite(all.light);
  c.residual = all.light > 0 ? all.moved / all.light : 0;
  c.mean_lx = all.area > 0 ? all.light / all.area : 0;
  return c;
}

}  // namespace

std::unique_ptr<Solver> make_solver(const SolverInput& in) {
  switch (in.settings.method) {
    case proto::Method::kPath:
      return make_path_solver(in);
    case proto::Method::kGather:
      break;
  }
  return make_gather_solver(in, std::uint64_t(in.settings.hit_memory_mib) << 20);
}

proto::Expected<Solution> solve(Solver& solver, const TextureGroup& texels, ThreadPool& pool,
                                std::stop_token stop, const SolveHooks& hooks, SolveStart from) {
  Solution solution;
  solution.passes = std::move(from.passes);
  std::shared_ptr<const Lightmap> before = std::move(from.light);
  if (!before) before = std::make_shared<Lightmap>(texels.size());
  for (std::size_t i = 0; i < solution.passes.size(); ++i)
    if (const auto pass = solver.next(std::span(solution.passes).first(i)))
      solution.tail_scale = std::max(solution.tail_scale, pass->tail_scale);
  std::stop_source either;  // what a pass under way listens to
  const std::stop_callback on_stop(stop, [&] { either.request_stop(); });
  const std::stop_callback on_enough(hooks.enough, [&] { either.request_stop(); });
  const auto enough = [&] {
    return hooks.enough.stop_requested() && !stop.stop_requested() && !solution.passes.empty();
  };
  const Workers workers{pool, either.get_token()};
  while (const auto pass = solver.next(solution.passes)) {
    if (enough()) break;
    if (hooks.before_pass) hooks.before_pass(*pass);
    const auto start = std::chrono::steady_clock::now();
    auto after = std::make_shared<Lightmap>(*before);
    bool whole = solver.begin(*pass, *before, *after, workers);
    const std::uint32_t size = pass->batch_texels;
    const std::uint32_t batches = (texels.size() + size - 1) / size;
    std::vector<std::uint64_t> rays(batches);
    std::atomic<std::uint32_t> done{0};
    whole = whole && pool.for_batches(batches, either.get_token(), [&](std::uint32_t b) {
      const TexelRange range{b * size, std::min((b + 1) * size, texels.size())};
      rays[b] = solver.run(*pass, *before, range, *after);
      if (hooks.on_batch) hooks.on_batch(*pass, ++done, batches);
    });
    proto::PassReport report;
    whole = whole && solver.finish(*pass, *after, workers, report);
    const auto change = whole ? measure(texels, *before, *after, workers) : std::nullopt;
    if (!change && enough()) break;
    if (!change) return proto::fail(proto::kCanceledCode, "The job was canceled.");

    if (!change->finite)
      return proto::fail("internal",
                         "The light of a texel is not finite after pass '" + pass->name + "'.");
    report.name = pass->name;
    report.index = pass->index;
    report.residual = change->residual;
    report.mean_lx = change->mean_lx;
    for (std::uint64_t r : rays) report.rays += r;
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    solution.passes.push_back(report);
    if (hooks.on_pass)
      if (auto ok = hooks.on_pass(*pass, report, after); !ok) return proto::Unexpected(ok.error());
    solution.tail_scale = std::max(solution.tail_scale, pass->tail_scale);
    before = std::move(after);
  }
  auto filtered = solver.filtered(*before, {pool, stop});
  if (!filtered) return proto::fail(proto::kCanceledCode, "The job was canceled.");
  solution.filtered = std::move(*filtered);
  solution.light = std::move(before);
  solution.ray_pattern = solver.ray_pattern();
  return solution;
}

}  // namespace kiln::baker
