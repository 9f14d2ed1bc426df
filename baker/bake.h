#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/atlas/texture_group.h"
#include "baker/exec/batch_queue.h"
#include "baker/exec/thread_pool.h"
#include "baker/import/import.h"
#include "baker/lightmap/lightmap.h"
#include "baker/upload_reader.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "proto/job.h"
#include "proto/manifest.h"

namespace kiln::baker {

/// A bake after some pass: what a preview shows. Shared and immutable.
struct Snapshot {
  std::shared_ptr<const atlas::TextureGroup> texels;
  std::shared_ptr<const lightmap::Lightmap> light;
  std::uint32_t pass = 0;
};

/// Receives the progress of a bake. Called from the thread that called bake(), unless another one
/// is named; must return quickly and must not throw.
class BakeObserver {
 public:
  virtual ~BakeObserver() = default;
  virtual void on_stage(const std::string& /*name*/) {}
  /// Reports the number of passes of an earlier attempt that are kept; on_pass() does not repeat
  /// them.
  virtual void on_resume(std::uint32_t /*passes*/) {}
  /// Follows on_resume(): reports the share, 0 to 1, of the next pass that is kept too.
  virtual void on_resume_within(const std::string& /*pass*/, double /*share*/) {}
  virtual void on_progress(const proto::JobProgress&) {}  ///< any thread; at most 20 per second
  /// Reports a finished pass, which no later attempt makes again. With checkpoints this comes once
  /// they hold it, from the thread that writes them, and may be some passes late.
  virtual void on_pass(const proto::PassReport&) {}
  /// Hands over the light after each pass, finished or not.
  // NOLINTNEXTLINE(performance-unnecessary-value-param): what overrides it takes it over
  virtual void on_snapshot(Snapshot) {}
  virtual void on_warning(const proto::Warning&) {}  ///< also from the thread of on_pass()
};

struct BakeInput {
  files::SceneFiles files;
  proto::BakeSettings settings;
  files::ImportLimits limits;
  std::filesystem::path output_dir;  ///< exists; receives the result files
  /// An existing folder, or empty for no checkpoints. A bake goes on from those that it finds
  /// there, and leaves its own.
  std::filesystem::path checkpoint_dir;
  std::string scene_sha256;  ///< SHA-256 of the main file, for the manifest
  std::string scene_key;     ///< names the content of all files
  std::stop_token
      finish_early;  ///< ends the passes early, to write the light of those that are done
  /// Reserves the memory that the bake may take, see estimate_memory(). It is called once, when the
  /// scene is known and nothing is made of it yet. It may wait for the memory; an error ends the
  /// bake.
  std::function<proto::Expected<void>(std::uint64_t bytes, std::stop_token)> reserve_memory = {};
  /// Reads the files, the sky map among them if the settings name one. Null: this process reads
  /// them, within the limits. One bake uses it at a time.
  std::shared_ptr<UploadReader> source = nullptr;
  /// The share of the processors' time that checkpoints may take; from 1 on each pass waits for its
  /// own. See CheckpointWriter.
  double checkpoint_share = 0.05;
  /// Passes that take longer are kept in the middle, too, about this often.
  std::chrono::milliseconds part_time{10'000};
  /// Runs the batches of the passes; null: the pool does. Outlives the bake.
  exec::BatchQueue* queue = nullptr;
};

/// Bakes a glTF scene into result files: import, atlas, solve, post, output. Same input and
/// settings give the same bytes of image whatever the pool's size and the queue. Errors: those of
/// the stages, and `canceled` within a second of a stop request.
proto::Expected<proto::Manifest> bake(const BakeInput&, exec::ThreadPool&, std::stop_token,
                                      BakeObserver&);

/// Names what a bake gives: scene, settings, version and instruction set. The same key means the
/// same pixels, bit by bit. 64 hexadecimal digits.
std::string bake_key(const std::string& scene_key, const proto::BakeSettings&);

/// Returns the instruction set that this machine bakes with: "sse2", "avx2" or "avx512". It is
/// recorded with every result, since pixels are bit-identical per instruction set only.
const char* instruction_set();

}  // namespace kiln::baker
