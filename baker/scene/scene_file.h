#pragma once

#include <cstdint>
#include <stop_token>
#include <string>
#include <string_view>

#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::scene {

/// A scene file is a Scene as a flat file (flat_file.h), the product of an import. The process that
/// writes it may be under the control of the bytes it decoded; the process that reads it must stay
/// safe. So the file holds no index that follows from other data, and the reader checks every
/// count, index, enumeration and number before it uses them.
///
/// The file holds what import_files() returns, without the lights and the sky of the settings, so
/// one file serves all bakes of a scene with the same sky map. It does not hold the glTF document,
/// which lit.glb repeats: then the service would have to parse the JSON that only confined
/// processes may parse. A confined process writes lit.glb too, from the upload itself
/// (upload_reader.h).

/// The version of the layout and of the import's results. Raise it when the layout changes or when
/// an import makes something else of the same bytes. Every import key contains it.
inline constexpr std::uint32_t kSceneFileVersion = 5;

/// Writes the file from the descriptor's current offset on. The same scene and key give the same
/// bytes. Errors: `storage_full`, `io_error`.
proto::Expected<void> write_scene_file(int fd, const std::string& key, const Scene&);

/// Reads a scene file. Any bytes are safe to read. A returned scene keeps every promise of scene.h
/// except the order of source_vertex. Memory stays within a small multiple of the file's length.
/// Errors: `bad_document`, `canceled`.
proto::Expected<Scene> read_scene_file(std::string_view bytes, const std::string& key,
                                       std::stop_token = {});

}  // namespace kiln::scene
