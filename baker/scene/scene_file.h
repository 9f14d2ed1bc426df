#pragma once

#include <cstdint>
#include <stop_token>
#include <string>
#include <string_view>

#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::scene {

/// A Scene as a flat file (flat_file.h): the product of an import, made by a process that may have
/// been taken over by the bytes it decoded, and read by one that must not be. So the file holds
/// nothing that could be told wrongly without being found out: no indices that follow from others,
/// and whoever reads it checks every count, index, enumeration and number before it is used.
///
/// It holds what import_files() gives, without the lights and the sky of the settings: one file
/// serves all bakes of a scene with the same sky map. It does not hold the glTF document. lit.glb
/// repeats that, and carrying the JSON along would have the service parse what it keeps the import
/// away from: it is written by such a process too, from the upload itself (upload_reader.h).

/// The version of the layout and of what an import makes of the same bytes. Raise it when either
/// changes: every import key holds it.
inline constexpr std::uint32_t kSceneFileVersion = 4;

/// Writes from the descriptor's present place on. Same scene and key give the same bytes.
/// Errors: `storage_full`, `io_error`.
proto::Expected<void> write_scene_file(int fd, const std::string& key, const Scene&);

/// Any bytes are safe to read, and a scene that is returned holds all that scene.h promises, but
/// for how source_vertex is ordered. Takes no more memory than a small multiple of the file's
/// length. Errors: `bad_document`, `canceled`.
proto::Expected<Scene> read_scene_file(std::string_view bytes, const std::string& key,
                                       std::stop_token = {});

}  // namespace kiln::scene
