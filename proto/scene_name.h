#pragma once

#include <string>
#include <vector>

namespace kiln::proto {

/// A file that a scene's main file refers to.
struct SideDigest {
  std::string name;  ///< as the main file refers to it
  std::string sha256;
};

/// The name of a scene by its content. The key of a scene without side files is the SHA-256 of the
/// file; with side files it is the SHA-256 of the index, the text "<sha256 of main>  \n" followed
/// by one line "<sha256>  <name>\n" per side file, sorted by name.
struct SceneName {
  std::string key, index;
};
SceneName scene_name(const std::string& main_sha256, std::vector<SideDigest> side);

}  // namespace kiln::proto
