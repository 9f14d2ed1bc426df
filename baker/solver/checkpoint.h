#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "baker/solver/lightmap.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::baker {

/// The light after a finished pass, as a file: what a bake needs to go on from there. Little-endian
/// planes behind a header with a check sum; the newest replaces the one before in one rename.
struct Checkpoint {
  std::string key;  ///< names scene, settings and program: light of another bake is refused
  std::vector<proto::PassReport> passes;  ///< all that are finished
  Lightmap light;
};

/// Durable once it returns. Errors: `io_error`.
proto::Expected<void> write_checkpoint(const std::filesystem::path& dir, const std::string& key,
                                       std::span<const proto::PassReport>, const Lightmap&);
/// Errors: `no_checkpoint` when there is none, or it is torn, of another version or of another key.
proto::Expected<Checkpoint> read_checkpoint(const std::filesystem::path& dir,
                                            const std::string& key);

}  // namespace kiln::baker
