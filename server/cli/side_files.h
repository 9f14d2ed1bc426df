#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "proto/expected.h"

namespace kiln::cli {

/// Files that a scene needs, by the name that it uses for each.
using SideFiles = std::map<std::string, std::filesystem::path>;

/// Finds the buffers and images that a .gltf or .glb names by relative URIs and that lie in its
/// folder or below. Leaves out what it names outside, by absolute paths or other schemes, and what
/// does not exist: the import says what is wrong with those. A scene that can't be read names
/// nothing.
SideFiles find_side_files(const std::filesystem::path& scene);

/// Returns find_side_files(), the sky map of the settings if it lies there too, and those that the
/// user names, each under its file name; the user's win. Errors: `missing_file` when one of the
/// user's can't be read or two share a name.
proto::Expected<SideFiles> all_side_files(const std::filesystem::path& scene,
                                          const std::vector<std::string>& named,
                                          const std::optional<std::string>& sky_map = {});

}  // namespace kiln::cli
