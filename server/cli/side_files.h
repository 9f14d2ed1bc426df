#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::cli {

/// The files that a scene needs, by the names that it uses.
struct SideFiles {
  std::map<std::string, std::filesystem::path> files;
  bool images = true;  ///< false: an import of the scene decodes no image and no sky map
};

/// Finds the buffers and images that a .gltf or .glb names by relative URIs and that lie in its
/// folder or below. It leaves out files elsewhere, absolute paths, other schemes and files that do
/// not exist: the import reports those. A scene that can't be read gives no files.
SideFiles find_side_files(const std::filesystem::path& scene);

/// Returns the files of find_side_files(), the sky map of the settings and the file that their
/// report compares with if they lie there too (with other pages of the latter), and the files that
/// the user names, each under its file name. The user's files win. Errors: `missing_file` when one
/// of the user's files can't be read or two share a name.
proto::Expected<SideFiles> all_side_files(const std::filesystem::path& scene,
                                          const std::vector<std::string>& named,
                                          const std::optional<std::string>& sky_map = {},
                                          const proto::ReportSettings& report = {});

}  // namespace kiln::cli
