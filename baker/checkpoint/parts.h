#pragma once

#include <cstdint>
#include <filesystem>
#include <stop_token>
#include <string>

#include "baker/lightmap/lightmap.h"
#include "baker/lightmap/texel_patch.h"
#include "baker/solver/pass.h"
#include "proto/expected.h"

/// The parts of a long pass hold what it has computed so far. They follow each other, each in a
/// file of its own (part_0.bin, part_1.bin, ...) beside the checkpoint that the pass began with. A
/// part is a patch of some batches, in the bytes of lightmap/texel_patch.h.
namespace kiln::checkpoint {

/// Stores the values of the texels of a patch's head: those of the planes that it writes, as they
/// are in `after`. They are durable when it returns. head.bytes is ignored.
/// @param number counts the parts from 0
/// Errors: `storage_full`, `io_error`, and `canceled` within a second of a stop request.
proto::Expected<void> write_part(const std::filesystem::path& dir, const std::string& key,
                                 std::uint32_t number, lightmap::PatchHead head,
                                 const lightmap::Lightmap& after, std::stop_token = {});

/// The parts of a pass, and the progress that they hold together.
struct StoredParts {
  std::uint32_t count = 0;
  solver::PassProgress progress;
};
/// Restores the parts of a pass up to the first that is missing, damaged, or of another bake or
/// pass. `after` holds the light that the pass began with, and is ready for writing. A stop request
/// ends it early.
StoredParts read_parts(const std::filesystem::path& dir, const std::string& key,
                       const solver::PassPlan&, const lightmap::Lightmap& before,
                       lightmap::Lightmap& after, std::stop_token = {});

void remove_parts(const std::filesystem::path& dir);

}  // namespace kiln::checkpoint
