#include "proto/scene_name.h"

#include <algorithm>

#include "proto/sha256.h"

namespace kiln::proto {

SceneName scene_name(const std::string& main_sha256, std::vector<SideDigest> side) {
  std::sort(side.begin(), side.end(),
            [](const SideDigest& a, const SideDigest& b) { return a.name < b.name; });
  SceneName name;
  name.index = main_sha256 + "  \n";
  for (const auto& file : side) name.index += file.sha256 + "  " + file.name + "\n";
  name.key = side.empty() ? main_sha256 : sha256_hex(name.index);
  return name;
}

}  // namespace kiln::proto
