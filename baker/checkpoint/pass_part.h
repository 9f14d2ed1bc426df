#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <stop_token>
#include <string>

#include "baker/atlas/texture_group.h"
#include "baker/lightmap/lightmap.h"
#include "baker/solver/solve.h"
#include "proto/expected.h"

/// What a pass that takes long has computed so far: parts of it, one behind the other, each in a
/// file of its own (part_0.bin, part_1.bin, ...) beside the checkpoint that the pass began with.
namespace kiln::checkpoint {

/// Texels of a pass under way whose batches are done.
struct PassPart {
  std::uint32_t pass = 0;  ///< its index
  std::uint32_t number = 0;
  atlas::TexelRange texels{0, 0};
  std::uint64_t rays = 0;  ///< traced for them
  double seconds = 0;      ///< that they took
};

/// Stores the values of these texels: of the planes that the pass has made its own in `after`, and
/// of the solver's state, which is empty unless the pass fills it, the same number of bytes per
/// texel. Durable once it returns. Errors: `storage_full`, `io_error`, and `canceled` within a
/// second of a stop request.
proto::Expected<void> write_part(const std::filesystem::path& dir, const std::string& key,
                                 const PassPart&, const lightmap::Lightmap& before,
                                 const lightmap::Lightmap& after, std::span<const std::byte> state,
                                 std::stop_token = {});

/// What parts hold together.
struct StoredParts {
  std::uint32_t count = 0;
  solver::PassProgress progress;
};
/// Restores the parts of a pass up to the first that is missing, damaged, or of another bake or
/// pass. `after` and `state` are as the pass began with them. Stops early on a stop request.
StoredParts read_parts(const std::filesystem::path& dir, const std::string& key,
                       const solver::Pass&, const lightmap::Lightmap& before,
                       lightmap::Lightmap& after, std::span<std::byte> state, std::stop_token = {});

void remove_parts(const std::filesystem::path& dir);

}  // namespace kiln::checkpoint
