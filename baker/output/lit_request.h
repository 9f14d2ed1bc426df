#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/output/output.h"
#include "proto/expected.h"

namespace kiln::output {

/// The input of write_lit_glb() beside the upload and its scene, as a flat file (flat_file.h) for
/// the process that writes lit.glb.
struct LitRequest {
  atlas::Atlas atlas;  ///< as far as lit.glb goes: one chart for each page, none of its bounds
  std::vector<LitPage> pages;
};

/// Errors: `storage_full`, `io_error`.
proto::Expected<void> write_lit_request(int fd, const atlas::Atlas&, std::span<const LitPage>);

/// Reads a request. Any bytes are safe to read; the atlas fits the scene. Errors: `bad_document`.
proto::Expected<LitRequest> read_lit_request(std::string_view bytes, const scene::Scene&);

}  // namespace kiln::output
