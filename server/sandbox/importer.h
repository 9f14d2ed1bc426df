#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "baker/upload_reader.h"
#include "server/base/memory_budget.h"
#include "server/sandbox/checked_scenes.h"
#include "server/sandbox/supervisor.h"

namespace kiln::sandbox {

/// Reads uploads in processes of their own (supervisor.h): this one never decodes a byte of them,
/// it maps the scene files that come out and checks every number in those. Thread-safe.
///
/// lit.glb repeats the upload's document and images. It is made by such a process as well, which
/// reads the document once more: the one that imported it is gone, since its memory would be
/// missing to the bake. Were the document carried along in the scene file, this process would have
/// to parse it, and a process that was taken over could have written it.
class Importer {
 public:
  struct Options {
    ImportProcessOptions process;
    files::ImportLimits limits;
    /// False when the scenes are known to have neither images nor sky maps: their imports then do
    /// not wait for process.zygote.
    bool decodes_images = true;
    /// The processes share this with bakes. They wait for their turn, start with what their work
    /// lets expect, and are started again with more where that is not enough, each time with
    /// process.seconds anew. Null: each may take process.memory_bytes.
    std::shared_ptr<base::MemoryBudget> memory = nullptr;
    std::chrono::milliseconds patience{10'000};  ///< of check(), for its turn
    /// Gives names for files that are about to be renamed, on the disk of the caches that open()
    /// gets. It is not called without a cache.
    std::function<std::filesystem::path()> new_temporary;
  };
  explicit Importer(Options);

  /// Starts a process that does nothing. Errors: those of starting one.
  proto::Expected<Confinement> probe() const;

  /// Checks as import::check_scene() does. The process that passed a scene is kept
  /// (checked_scenes.h) and imports it when open() asks for the same files with the same sky map.
  /// One more error: `overloaded`, its turn did not come in time.
  proto::Expected<void> check(const files::SceneFiles&, const proto::BakeSettings&,
                              std::stop_token = {}) const;

  /// For one bake. `scene_key` names the content of all files. The scene file is kept in the folder
  /// `cache`, as <16 digits of its import_key()>-<its SHA-256>.scene, and found there by the next
  /// bake of that scene with the same sky map; the four that were used last stay.
  /// With an empty path it lies in memory. A kept file is used only when its bytes have the digest
  /// of its name. A file that is out of proportion to the upload is not kept: an image of some
  /// kilobytes may decode to a gigabyte, and a disk is soon filled with those. The processes draw
  /// on the reservation that `job` has in Options::memory, see MemoryBudget::enter(); "": on
  /// nobody's.
  std::shared_ptr<baker::UploadReader> open(files::SceneFiles, const std::string& scene_key,
                                            std::filesystem::path cache,
                                            const std::string& job = {}) const;

 private:
  Options options_;
  std::shared_ptr<CheckedScenes> checked_;
};

}  // namespace kiln::sandbox
