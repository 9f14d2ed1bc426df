#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/solver/solve.h"
#include "proto/expected.h"
#include "proto/manifest.h"

/// What a bake needs to go on after the process that ran it is gone. A folder holds the light after
/// the last two passes, in two files that take turns (pass_0.bin, pass_1.bin), and the solver's
/// state (state.bin): little-endian arrays behind a header, with a SHA-256 over all of it. Each is
/// replaced in one rename. Beside them parts of the pass that follows (PassPart). The state is read
/// for light that is not complete yet.
namespace kiln::checkpoint {

/// Stores the light after `passes`, in place of that of the pass before the last. Durable once it
/// returns. `key` names scene, settings and program: light of another bake is refused.
/// Errors: `storage_full`, `io_error`, and `canceled` within a second of a stop request.
proto::Expected<void> write_checkpoint(const std::filesystem::path& dir, const std::string& key,
                                       std::span<const proto::PassReport> passes,
                                       const lightmap::Lightmap&, std::stop_token = {});

/// Stores Solver::state() as passes with `fills_state` left it; before write_checkpoint() of the
/// first light that needs it. It may be large, so it is not flushed to the disk: after a power
/// failure its check sum tells.
/// Errors: `storage_full`, `io_error`, and `canceled` within a second of a stop request.
proto::Expected<void> write_state(const std::filesystem::path& dir, const std::string& key,
                                  std::span<const std::byte> state, std::stop_token = {});

/// The newest light in the folder that `solver` can go on from; restores the solver's state.
/// Nothing when the folder holds none.
/// Errors: `invalid_checkpoint` when what is there is damaged, or of another bake. The solver then
/// has to begin at its first pass. `canceled` within a second of a stop request.
proto::Expected<std::optional<solver::SolveStart>> read_checkpoint(const std::filesystem::path& dir,
                                                                   const std::string& key,
                                                                   solver::Solver& solver,
                                                                   std::uint32_t texels,
                                                                   std::stop_token = {});

void remove_checkpoints(const std::filesystem::path& dir);

}  // namespace kiln::checkpoint
