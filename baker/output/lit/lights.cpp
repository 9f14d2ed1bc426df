#include "baker/output/lit/lights.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <vector>

namespace kiln::output::lit {
namespace {

constexpr const char* kLights = "KHR_lights_punctual";

/// Returns the nodes of the scene that a bake takes: `scene`, or else the first; all without one.
std::vector<bool> baked_nodes(const Json& document) {
  const std::size_t count = document.value("nodes", Json::array()).size();
  const Json scenes = document.value("scenes", Json::array());
  if (scenes.empty()) return std::vector<bool>(count, true);
  std::vector<bool> baked(count, false);
  std::vector<std::uint64_t> open;
  const auto add = [&](const Json& owner, const char* member) {
    for (const Json& node : owner.value(member, Json::array()))
      if (const auto n = as_count(node); n && *n < count && !baked[*n]) {
        baked[*n] = true;
        open.push_back(*n);
      }
  };
  add(scenes.at(count_at(document, "scene", 0).value_or(0)), "nodes");
  while (!open.empty()) {
    const std::uint64_t n = open.back();
    open.pop_back();
    add(document["nodes"][n], "children");
  }
  return baked;
}

bool has_light(const Json& node) {
  const auto extensions = node.find("extensions");
  return extensions != node.end() && extensions->contains(kLights);
}

void drop_name(Json& document, const char* list) {
  const auto names = document.find(list);
  if (names == document.end() || !names->is_array()) return;
  names->erase(std::remove(names->begin(), names->end(), kLights), names->end());
  if (names->empty()) document.erase(list);  // an empty list is not valid
}

/// Says whether a pointer of KHR_animation_pointer leads to a light that is gone.
bool leads_nowhere(std::string_view pointer, const Json& document) {
  constexpr std::string_view kList = "/extensions/KHR_lights_punctual", kNodes = "/nodes/";
  if (pointer.starts_with(kList))
    return !document.contains("extensions") || !document["extensions"].contains(kLights);
  if (!pointer.starts_with(kNodes)) return false;
  std::uint64_t node = 0;
  const char* const end = pointer.data() + pointer.size();
  const auto [rest, error] = std::from_chars(pointer.data() + kNodes.size(), end, node);
  return error == std::errc() && std::string_view(rest, end).starts_with(kList) &&
         node < document["nodes"].size() && !has_light(document["nodes"][node]);
}

bool is_of_no_light(const Json& channel, const Json& document) {
  static const Json::json_pointer kPointer("/target/extensions/KHR_animation_pointer/pointer");
  if (!channel.contains(kPointer) || !channel[kPointer].is_string()) return false;
  return leads_nowhere(channel[kPointer].get_ref<const std::string&>(), document);
}

void drop_animations(Json& document) {
  const auto found = document.find("animations");
  if (found == document.end() || !found->is_array()) return;
  Json kept = Json::array();
  for (Json& animation : *found) {
    const auto channels = animation.find("channels");
    if (channels == animation.end() || !channels->is_array()) {
      kept.push_back(std::move(animation));
      continue;
    }
    const std::size_t before = channels->size();
    channels->erase(
        std::remove_if(channels->begin(), channels->end(),
                       [&](const Json& channel) { return is_of_no_light(channel, document); }),
        channels->end());
    if (!channels->empty() || before == 0) kept.push_back(std::move(animation));
  }
  if (kept.empty() && !found->empty())
    document.erase("animations");
  else
    *found = std::move(kept);
}

}  // namespace

void drop_baked_lights(Json& document) {
  if (!document.contains("nodes")) return;
  const std::vector<bool> baked = baked_nodes(document);
  Json& nodes = document["nodes"];
  bool any = false, left = false;
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (!has_light(nodes[n])) continue;
    if (!baked[n]) {
      left = true;
      continue;
    }
    any = true;
    drop_extension(nodes[n], kLights);
  }
  if (!any) return;
  if (!left) {
    drop_extension(document, kLights);
    drop_name(document, "extensionsUsed");
    drop_name(document, "extensionsRequired");
  }
  drop_animations(document);
}

}  // namespace kiln::output::lit
