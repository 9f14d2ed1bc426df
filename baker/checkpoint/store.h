#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/lightmap/lightmap.h"
#include "baker/solver/solver.h"
#include "proto/expected.h"
#include "proto/manifest.h"

/// Files that let a bake go on after the process that ran it is gone. A folder holds the light
/// after the last two passes, in two files that take turns (pass_0.bin, pass_1.bin), and the planes
/// that passes share (state.bin, see lightmap::shared_planes). Each file has little-endian arrays
/// behind a header, with a SHA-256 over all of it, and is replaced in one rename.
///
/// Beside them are parts of the pass that follows (parts.h). The shared planes are read for light
/// that is not complete yet.
namespace kiln::checkpoint {

/// Stores the light after `passes`, without its shared planes, in place of the light of the pass
/// before the last. It is durable on return. `key` names scene, settings and program: light of
/// another bake is refused. Errors: `storage_full`, `io_error`, and `canceled` within a second of a
/// stop request.
proto::Expected<void> write_checkpoint(const std::filesystem::path& dir, const std::string& key,
                                       std::span<const proto::PassReport> passes,
                                       const lightmap::Lightmap&, std::stop_token = {});

/// Stores the shared planes of a light. It is called before write_checkpoint() of the first light
/// that needs them in this state. They may be large, so they are not flushed to the disk: after a
/// power failure the check sum shows the damage. Errors: `storage_full`, `io_error`, and `canceled`
/// within a second of a stop request.
proto::Expected<void> write_shared(const std::filesystem::path& dir, const std::string& key,
                                   const lightmap::Lightmap&, std::stop_token = {});

/// Returns whether a pass leaves in shared planes what later passes need.
inline bool fills_shared(const solver::PassPlan& plan) {
  return (plan.writes & lightmap::shared_planes()).any();
}

/// Reads the newest light in the folder that `solver` can go on from, or nothing when the folder
/// holds none. Errors: `invalid_checkpoint` when the files are damaged, or belong to another bake
/// or another version of the format: the solver then has to begin at its first pass. `canceled`
/// within a second of a stop request.
proto::Expected<std::optional<solver::SolveStart>> read_checkpoint(const std::filesystem::path& dir,
                                                                   const std::string& key,
                                                                   const solver::Solver& solver,
                                                                   std::uint32_t texels,
                                                                   std::stop_token = {});

void remove_checkpoints(const std::filesystem::path& dir);

}  // namespace kiln::checkpoint
