#pragma once

#include <functional>
#include <map>
#include <ostream>
#include <string>
#include <vector>

namespace kiln::test {

/// A scene whose light must not change by a bit. Together the scenes reach most of the baker.
struct GuardedScene {
  std::string name;
  std::function<std::string()> glb;
  std::string settings;                     ///< JSON, for every bake of it
  std::string fine;                         ///< JSON, more for its bake on several pages
  std::map<std::string, std::string> side;  ///< bytes of the files beside it

  friend void PrintTo(const GuardedScene& scene, std::ostream* out) { *out << scene.name; }
};

/// Returns the scenes, always in the same order.
std::vector<GuardedScene> guarded_scenes();

}  // namespace kiln::test
