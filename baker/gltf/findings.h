#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::gltf {

/// Returns the error that the scene is wrong at this place of the glTF.
inline proto::Unexpected invalid(const std::string& why, const std::string& pointer) {
  return proto::fail("invalid_scene", why, "scene", pointer);
}

/// Returns the error that the scene asks for more than one of the ImportLimits allows: `name` is
/// the limit's, as GET /v1/capabilities has it.
inline proto::Unexpected over_limit(const std::string& what, std::uint64_t limit, const char* name,
                                    const std::string& pointer) {
  return proto::fail(
      "limit_exceeded",
      what + ": the limit `" + name + "` of this service is " + std::to_string(limit), "scene",
      pointer);
}

/// Warnings of one import. A scene may give the same one at a million places: each code is kept
/// once per message, with its first place and the number of places.
class WarningList {
 public:
  void add(const std::string& code, const std::string& pointer, const std::string& message,
           std::uint64_t times = 1) {
    const auto [found, is_new] = index_.try_emplace({code, message}, entries_.size());
    if (is_new) entries_.push_back({{code, pointer, message}, 0});
    entries_[found->second].times += times;
  }

  /// Returns them in order of first appearance.
  std::vector<proto::Warning> take() {
    std::vector<proto::Warning> out;
    for (Entry& entry : entries_) {
      if (entry.times > 1) entry.warning.message += " (" + std::to_string(entry.times) + " times)";
      out.push_back(std::move(entry.warning));
    }
    entries_.clear();
    index_.clear();
    return out;
  }

 private:
  struct Entry {
    proto::Warning warning;
    std::uint64_t times = 0;
  };
  std::vector<Entry> entries_;
  std::map<std::pair<std::string, std::string>, std::size_t> index_;
};

}  // namespace kiln::gltf
