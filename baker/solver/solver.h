#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/denoise/filter_bank.h"
#include "baker/exec/workers.h"
#include "baker/light/light_set.h"
#include "baker/lightmap/lightmap.h"
#include "baker/scene/scene.h"
#include "baker/solver/sample_plan.h"
#include "baker/solver/work.h"
#include "baker/trace/ray_scene.h"
#include "baker/trace/texel_surface.h"
#include "proto/bake_settings.h"
#include "proto/manifest.h"

namespace kiln::solver {

/// What every method reads. Outlives the solver; immutable.
struct SolverInput {
  const scene::Scene& scene;
  const atlas::Atlas& atlas;
  const atlas::TextureGroup& texels;
  const trace::RayScene& rays;
  const light::LightSet& lights;
  const trace::TexelLookup& lookup;
  proto::SolverSettings settings;
  SamplePlan plan = sample_plan(settings, {});
  bool filter = true;  ///< smooth the light that is gathered
};

/// One sweep over all texels, between two barriers.
struct Pass {
  std::string name;
  std::uint32_t index = 0;           ///< over the whole bake
  std::uint32_t batch_texels = 256;  ///< texels in one batch: at most about 50 ms of work
  std::uint32_t first_sample = 0, sample_count = 0;  ///< of each texel
  Work work;                                         ///< expected effort of the batches
  Work finish_work;                                  ///< and of finish()
  bool fills_state = false;  ///< leaves in Solver::state() what later passes read
  bool completes = false;    ///< the light has all its bounces afterwards
  double tail_scale = 0;     ///< factor on the update that stands for the bounces that are left out
};

/// One light-transport method. A bake calls next(), then run() for ranges that cover every texel
/// once, then finish(); and so on until next() gives nothing. run() may be called from many threads
/// at once; the others only between passes. Same pass and range give the same bits on any thread.
class Solver {
 public:
  virtual ~Solver() = default;
  /// The pass after those reported, or nothing when the light has converged or the limit is
  /// reached.
  virtual std::optional<Pass> next(std::span<const proto::PassReport> done) const = 0;
  virtual std::uint32_t max_passes() const = 0;
  /// Expected effort of all passes. May change with what they find.
  virtual Work total_work() const = 0;
  /// Share of the work of a pass that is under way in the first `share` of its texels.
  virtual double work_share(const Pass&, double share) const { return share; }
  /// Called once before the pass's batches, from one thread. `after` is a copy of `before`; makes
  /// its own the planes that the pass changes. False when stopped.
  virtual bool begin(const Pass&, const lightmap::Lightmap& before, lightmap::Lightmap& after,
                     const exec::Workers&) = 0;
  /// Computes the texels of `range` from the light before the pass; writes no others. Ranges begin
  /// at multiples of pass.batch_texels.
  /// @return rays traced
  virtual std::uint64_t run(const Pass&, const lightmap::Lightmap& before, atlas::TexelRange range,
                            lightmap::Lightmap& after) = 0;
  /// Called once after the pass's batches, from one thread. Says in the report what only the method
  /// knows. False when stopped.
  virtual bool finish(const Pass&, lightmap::Lightmap& /*after*/, const exec::Workers&,
                      proto::PassReport&) {
    return true;
  }
  /// What passes with `fills_state` leave beside the light for later ones, until one of them
  /// completes it. A checkpoint between them stores it, and writes it back to a solver that has run
  /// none, whose state is zeros. Empty: there is none.
  virtual std::span<std::byte> state() { return {}; }
  /// How gathered rays are put into packets, see PacketPlan; empty where none are.
  virtual std::string ray_pattern() const { return {}; }
  /// The light as it is to be shown, with what is known of its error. Nothing when stopped.
  virtual std::optional<denoise::FilteredLight> filtered(const lightmap::Lightmap&,
                                                         const exec::Workers&) = 0;
};

}  // namespace kiln::solver
