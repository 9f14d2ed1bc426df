#pragma once

#include <cstdint>
#include <filesystem>
#include <stop_token>
#include <string>

#include "baker/lightmap/lightmap.h"
#include "baker/lightmap/texel_patch.h"
#include "baker/solver/pass.h"
#include "proto/expected.h"

/// What a pass that takes long has computed so far: parts of it, one behind the other, each in a
/// file of its own (part_0.bin, part_1.bin, ...) beside the checkpoint that the pass began with. A
/// part is a patch of some batches, in the very bytes of lightmap/texel_patch.h.
namespace kiln::checkpoint {

/// Stores the values of the texels of a patch's head: of the planes that it writes, as they are in
/// `after`. Durable once it returns. @param number of the part, from 0. head.bytes is ignored.
/// Errors: `storage_full`, `io_error`, and `canceled` within a second of a stop request.
proto::Expected<void> write_part(const std::filesystem::path& dir, const std::string& key,
                                 std::uint32_t number, lightmap::PatchHead head,
                                 const lightmap::Lightmap& after, std::stop_token = {});

/// What parts hold together.
struct StoredParts {
  std::uint32_t count = 0;
  solver::PassProgress progress;
};
/// Restores the parts of a pass up to the first that is missing, damaged, or of another bake or
/// pass. `after` is as the pass began with it, ready for writing. Stops early on a stop request.
StoredParts read_parts(const std::filesystem::path& dir, const std::string& key,
                       const solver::PassPlan&, const lightmap::Lightmap& before,
                       lightmap::Lightmap& after, std::stop_token = {});

void remove_parts(const std::filesystem::path& dir);

}  // namespace kiln::checkpoint
