#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "baker/atlas/texture_group.h"
#include "baker/exec/workers.h"
#include "baker/lightmap/lightmap.h"
#include "baker/lightmap/planes.h"
#include "baker/lightmap/texel_patch.h"
#include "baker/solver/work.h"
#include "proto/manifest.h"

namespace kiln::solver {

/// Tells what a light that is not complete yet already shows, for the forecast of the rounds to
/// come.
enum class Shows { kNothingNew, kDirect, kFirstBounce };

/// Describes a pass. A round learns in prepare() which planes it changes and how much work that is.
/// Everything else is known before, and is the same in every process.
struct PassPlan {
  std::string name;                  ///< for people and reports only
  std::uint32_t index = 0;           ///< number in the whole bake
  std::uint32_t batch_texels = 256;  ///< texels in one batch: at most about 50 ms of work
  /// The planes of the light before that prepare() or batches read, of any texel. A process that
  /// computes batches needs these, and `writes` of the texels of its own ranges.
  lightmap::PlaneSet reads;
  lightmap::PlaneSet writes;    ///< what batches write, and a TexelPatch of the pass holds
  lightmap::PlaneSet finishes;  ///< what finish() writes; may name planes of `writes` too
  Work work;                    ///< expected effort of the batches
  Work finish_work;             ///< expected effort of finish()
  /// The light has all its bounces afterwards. It is judged then, and shared planes are dropped.
  bool completes = false;
  Shows shows = Shows::kNothingNew;
  double tail_scale = 0;  ///< factor on the update that stands for the bounces that are left out
};

/// One sweep over all texels, between two barriers: prepare(), then run() for ranges that cover
/// every texel once, then finish(). After prepare(), run() is a pure function of the light before,
/// so that a batch may run on any thread, in any order, and in another process that has prepared
/// the same pass. Same pass and range give the same bits.
class Pass {
 public:
  explicit Pass(PassPlan plan) : plan_(std::move(plan)) {
    if (plan_.completes) plan_.finish_work = Work::other(work::kFilter);
  }
  virtual ~Pass() = default;
  Pass(const Pass&) = delete;
  Pass& operator=(const Pass&) = delete;

  const PassPlan& plan() const { return plan_; }
  /// Makes what all batches need from the light before. Called once, from one thread, first.
  /// Returns false when stopped.
  virtual bool prepare(const lightmap::Lightmap& /*before*/, const exec::Workers&) { return true; }
  /// Computes the texels of `range`, which begins at a multiple of batch_texels, and writes no
  /// others. `after` holds what `before` does. Callable from many threads at once.
  /// @return rays traced
  virtual std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap& before,
                            const lightmap::LightmapView& after) const = 0;
  /// Does what needs all texels at once. Called once after the batches, from one thread. Returns
  /// false when stopped.
  virtual bool finish(lightmap::Lightmap& /*after*/, const exec::Workers&) { return true; }
  /// Returns the share of the pass's work in the first `share` of its texels. Callable from any
  /// thread after prepare().
  virtual double work_share(double share) const { return share; }

 protected:
  PassPlan plan_;
};

/// The progress of a pass.
struct PassProgress {
  std::uint32_t texels = 0;  ///< the first so many are done: whole batches
  std::uint64_t rays = 0;    ///< traced for them
  double seconds = 0;        ///< since the pass began
};

/// Computes a range apart from everything else, as a process does that returns a patch. Callable
/// from any thread.
lightmap::TexelPatch compute_patch(const Pass&, atlas::TexelRange,
                                   const lightmap::Lightmap& before);
/// Returns the form that such a patch must have.
lightmap::PatchForm patch_form(const PassPlan&, const lightmap::Lightmap&);

}  // namespace kiln::solver
