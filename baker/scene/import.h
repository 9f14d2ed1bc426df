#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "baker/scene/mapped_file.h"
#include "baker/scene/scene.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::baker {

/// The files of one upload. `side` is keyed by the name that came with each file; a URI in the glTF
/// matches the whole name, or else the last path component where exactly one file has it (curl
/// sends no folders). Nothing outside these files is ever opened.
struct SceneFiles {
  std::filesystem::path main;
  std::map<std::string, std::filesystem::path> side;
  /// Name of the one that is the sky map (the setting sky.map). Nothing: none is.
  std::optional<std::string> sky_map = std::nullopt;
  /// Where it is given, the paths are looked up here, and nothing is opened.
  std::shared_ptr<const OpenedFiles> opened = nullptr;
};

/// One of the files. Errors: as MappedFile::open.
proto::Expected<MappedFile> map_file(const SceneFiles&, const std::filesystem::path&,
                                     std::uint64_t max_bytes);

/// Limits on what a file may ask for. Checked before memory is taken; an error names the limit as
/// the member is called.
struct ImportLimits {
  std::uint64_t file_bytes = 1ull << 30;
  std::uint64_t json_bytes = 256ull << 20;
  std::uint32_t json_depth = 128;
  std::uint32_t nodes = 1'000'000;
  std::uint32_t node_depth = 256;
  std::uint64_t vertices = 64'000'000;
  std::uint64_t triangles = 32'000'000;
  std::uint64_t image_pixels = 1ull << 28;      ///< of one image
  std::uint64_t all_image_pixels = 1ull << 29;  ///< of all together
  std::uint32_t lights = 100'000;
};

/// Reads and checks everything short of decoding images: container, JSON, graph, accessors, and
/// that something can be baked. The sky map is the one that the settings name. Fast enough for a
/// request (50 MB within a second). Errors: `invalid_scene` (pointer into the glTF),
/// `unsupported_extension`, `missing_file`, `nothing_to_bake`, `no_light`, `limit_exceeded`,
/// `invalid_image` (of the sky map), `canceled`.
proto::Expected<void> check_scene(const SceneFiles&, const proto::BakeSettings&,
                                  const ImportLimits& = {}, std::stop_token = {});

/// The import without what settings add: geometry, materials, punctual lights, images and the sky
/// map that the files name, decoded. Same errors but `no_light`, and `invalid_image`. What is legal
/// but not honoured becomes a Scene::warning.
proto::Expected<Scene> import_files(const SceneFiles&, const ImportLimits& = {},
                                    std::stop_token = {});

/// Adds the lights and the sky of the settings to an imported scene. A sky map that gives no light
/// is dropped. Errors: `invalid_settings`, `no_light`; `missing_file` when the settings name a sky
/// map and the import had none; `canceled`.
proto::Expected<void> apply_settings(Scene&, const proto::BakeSettings&, std::stop_token = {});

/// Both of them: the scene that is baked.
proto::Expected<Scene> import_scene(const SceneFiles&, const proto::BakeSettings&,
                                    const ImportLimits& = {}, std::stop_token = {});

}  // namespace kiln::baker
