#pragma once

#include <string_view>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/output/output.h"
#include "proto/expected.h"

namespace kiln::output {

/// The input of write_lit_glb() beside the upload and its scene. It travels as a flat file
/// (flat_file.h) to the process that writes lit.glb.
struct LitRequest {
  atlas::Atlas atlas;  ///< only what lit.glb needs: one chart for each page, without bounds
  LitPages light;
};

/// Writes a request from the descriptor's current offset on. Errors: `storage_full`, `io_error`.
proto::Expected<void> write_lit_request(int fd, const atlas::Atlas&, const LitPages&);

/// Reads a request. Any bytes are safe to read, and a returned atlas fits the scene. Errors:
/// `bad_document`.
proto::Expected<LitRequest> read_lit_request(std::string_view bytes, const scene::Scene&);

}  // namespace kiln::output
