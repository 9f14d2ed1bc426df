#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "baker/files/mapped_file.h"
#include "proto/expected.h"

namespace kiln::files {

/// The files of one upload. The key in `side` is the name that the client sent with the file. A URI
/// in the glTF matches the whole name, or else the last path component where exactly one file has
/// it (curl sends no folders). No other file is ever opened.
struct SceneFiles {
  std::filesystem::path main;
  std::map<std::string, std::filesystem::path> side;
  /// The name of the file that is the sky map (the setting sky.map), if there is one.
  std::optional<std::string> sky_map = std::nullopt;
  /// When this is set, paths are looked up here, and no file is opened.
  std::shared_ptr<const OpenedFiles> opened = nullptr;
};

/// Maps one of the files. The errors are those of MappedFile::open().
proto::Expected<MappedFile> map_file(const SceneFiles&, const std::filesystem::path&,
                                     std::uint64_t max_bytes);

/// Limits on what a scene may hold. They are checked before memory is taken, and an error names the
/// member.
struct ImportLimits {
  std::uint64_t file_bytes = 1ull << 30;
  std::uint64_t json_bytes = 256ull << 20;
  std::uint32_t json_depth = 128;
  std::uint32_t nodes = 1'000'000;
  std::uint32_t node_depth = 256;
  std::uint64_t vertices = 64'000'000;
  std::uint64_t triangles = 32'000'000;
  std::uint64_t image_pixels = 1ull << 28;      ///< limit of one image
  std::uint64_t all_image_pixels = 1ull << 29;  ///< limit of all images together
  std::uint32_t lights = 100'000;
};

}  // namespace kiln::files
