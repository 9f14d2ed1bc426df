#pragma once

#include <stop_token>

#include "baker/gltf/json.h"
#include "proto/expected.h"

namespace tinygltf {
class Model;
}

namespace kiln::gltf {

/// Fills the library's structures, the one model of a document, from one that check_gltf() passed.
///
/// tinygltf reads the document's own text, with one rewrite, ParsedText::library_text. It leaves
/// out buffers and images, whose files and data URIs the library would load without limits, and
/// what no bake reads, which the schema check has not seen.
///
/// It also leaves out the three collections that grow with a scene: nodes, meshes and accessors are
/// copied from the parsed document. A second parse of their text and the library's way through it
/// take three times as long as all the rest of a check, and a file of 50 MB would not be answered
/// within a second. Properties of theirs that no bake reads stay at their defaults.
/// Errors: `invalid_scene`, `canceled`.
proto::Expected<void> read_model(tinygltf::Model&, const ParsedText&, const std::stop_token&);

}  // namespace kiln::gltf
