#include <algorithm>
#include <array>
#include <bit>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/json_values.h"
#include "proto/nearest_name.h"
#include "proto/problem_list.h"
#include "proto/settings_schema.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxKey = 128;  // the error for a longer key points to its parent

/// Returns the rows of one group without the group's name, or the top-level rows for the group "".
template <class Owner>
std::vector<std::pair<std::string_view, const SettingRow<Owner>*>> rows_of(
    std::string_view group, const std::vector<SettingRow<Owner>>& rows) {
  std::vector<std::pair<std::string_view, const SettingRow<Owner>*>> found;
  for (const auto& row : rows) {
    const auto dot = row.spec.path.find('.');
    const auto own = dot == std::string_view::npos ? "" : row.spec.path.substr(0, dot);
    if (own != group) continue;
    found.emplace_back(own.empty() ? row.spec.path : row.spec.path.substr(dot + 1), &row);
  }
  return found;
}

template <class Rows>
std::vector<std::string_view> names_of(const Rows& rows) {
  std::vector<std::string_view> names;
  names.reserve(rows.size());
  for (const auto& [name, row] : rows) names.push_back(name);
  return names;
}

void unknown_key(const std::string& parent, const std::string& key,
                 const std::vector<std::string_view>& known, ProblemList& problems) {
  problems.add(key.size() > kMaxKey ? parent : parent + "/" + pointer_token(key),
               "unknown setting \"" + brief(key) + "\"" + name_hint(key, known));
}

/// Reads one key of an object by the rows. Returns false when no row has that name.
template <class Owner, class Rows>
bool read_key(const Rows& rows, const std::string& pointer, const std::string& key,
              const json& value, Owner& out, ProblemList& problems) {
  const auto at =
      std::find_if(rows.begin(), rows.end(), [&](const auto& r) { return r.first == key; });
  if (at == rows.end()) return false;
  const auto& row = *at->second;
  if (auto wrong = check_value(row.spec, value))
    problems.add(pointer + "/" + key, std::move(*wrong));
  else
    row.write(out, value, row.spec);
  return true;
}

void read_group(const std::string& name, const json& group, BakeSettings& out,
                ProblemList& problems) {
  const std::string pointer = "/" + name;
  if (!group.is_object())
    return problems.add(pointer, "expected an object, found " + brief_value(group));
  const auto rows = rows_of(name, setting_rows());
  for (const auto& [key, value] : group.items())
    if (!read_key(rows, pointer, key, value, out, problems))
      unknown_key(pointer, key, names_of(rows), problems);
}

// Lights
// -------------------------------------------------------------------------------------------

bool uses(const SettingSpec& spec, LightType type) {
  return (spec.used_by >> static_cast<std::uint32_t>(type) & 1u) != 0;
}

/// Returns the keys that a light of this type may have.
std::vector<std::string_view> keys_of(LightType type) {
  std::vector<std::string_view> keys;
  for (const auto& row : light_rows())
    if (uses(row.spec, type)) keys.push_back(row.spec.path);
  return keys;
}

void check_unused(const std::string& pointer, const json& doc, LightType type,
                  ProblemList& problems) {
  const auto& type_word = light_rows().front().spec.choices.at(static_cast<std::size_t>(type));
  for (const auto& row : light_rows()) {
    const std::string key(row.spec.path);
    if (!doc.contains(key) || uses(row.spec, type)) continue;
    std::string known;
    for (const auto k : keys_of(type)) known.append(known.empty() ? "" : ", ").append(k);
    problems.add(pointer + "/" + key, "a light of type \"" + std::string(type_word) +
                                          "\" does not use \"" + key + "\"; it uses " + known);
  }
}

LightSettings read_light(const std::string& pointer, const json& doc, ProblemList& problems) {
  LightSettings light;
  if (!doc.is_object()) {
    problems.add(pointer, "expected an object, found " + brief_value(doc));
    return light;
  }
  const auto rows = rows_of("", light_rows());
  const SettingSpec& type = light_rows().front().spec;
  for (const auto& [key, value] : doc.items())
    if (!read_key(rows, pointer, key, value, light, problems))
      unknown_key(pointer, key, names_of(rows), problems);
  if (!doc.contains("type"))
    problems.add(pointer, "a light needs \"type\", " + expectation(type));
  else if (!check_value(type, doc.at("type")))
    check_unused(pointer, doc, light.type, problems);
  if (light.inner_cone_angle > light.outer_cone_angle)
    problems.add(pointer + "/inner_cone_angle",
                 "expected at most outer_cone_angle (" +
                     json(shortest_number(light.outer_cone_angle)).dump() + " rad), found " +
                     json(shortest_number(light.inner_cone_angle)).dump());
  return light;
}

void read_lights(const json& list, BakeSettings& out, ProblemList& problems) {
  if (!list.is_array())
    return problems.add("/lights", "expected a list of lights, found " + brief_value(list));
  if (list.size() > kMaxLights)
    return problems.add("/lights", "expected at most " + std::to_string(kMaxLights) +
                                       " lights, found " + std::to_string(list.size()));
  for (std::size_t i = 0; i < list.size(); ++i)
    out.lights.push_back(read_light("/lights/" + std::to_string(i), list[i], problems));
}

// Settings that don't go together
// -------------------------------------------------------------------------------------------

void check_directional(const SolverSettings& s, ProblemList& problems) {
  if (s.method != Method::kDirectional) return;
  if (s.samples.value_or(0) > SolverSettings::kMostDirections)
    problems.add("/solver/samples",
                 "expected at most " + std::to_string(SolverSettings::kMostDirections) +
                     " with method \"directional\", found " + std::to_string(*s.samples));
  if (s.rtrad_compat && s.direction_set == DirectionSetKind::kHemicube)
    problems.add("/solver/rtrad_compat",
                 "direction_set \"hemicube\" has weights of its own; RTRad's formula goes with "
                 "\"largest_empty_circle\"");
}

void check_output(const BakeSettings& s, ProblemList& problems) {
  const auto has = [&](const char* layer) {
    return std::ranges::find(s.output.layers, layer) != s.output.layers.end();
  };
  if (has("error") && !s.report.against)
    problems.add("/output/layers",
                 "the layer \"error\" is the difference to a reference: expected report.against");
  if ((has("tree") || s.solver.subdivision_threshold) &&
      !std::has_single_bit(s.solver.subdivision_max_node))
    problems.add("/solver/subdivision_max_node",
                 "expected a power of two, found " + std::to_string(s.solver.subdivision_max_node));
  if (s.output.glb_mode == GlbMode::kUnlit && s.output.glb_lightmap != GlbLightmap::kSrgb8)
    problems.add("/output/glb_lightmap",
                 "the colors of unlit materials are plain sRGB: expected \"srgb8\" with glb_mode "
                 "\"unlit\"");
  if (s.output.tone_curve && s.output.exposure)
    problems.add("/output/tone_curve",
                 "the curve goes by the brightest value of a page: expected null with exposure");
}

json light_json(const LightSettings& light) {
  json doc = json::object();
  for (const auto& row : light_rows())
    if (uses(row.spec, light.type)) doc[std::string(row.spec.path)] = row.read(light, row.spec);
  return doc;
}

// Schema
// -------------------------------------------------------------------------------------------

json closed_object(json properties) {
  return {
      {"type", "object"}, {"additionalProperties", false}, {"properties", std::move(properties)}};
}

template <class Owner>
json row_schema(const SettingRow<Owner>& row) {
  json schema = value_schema(row.spec);
  schema["default"] = row.read(Owner{}, row.spec);
  const auto methods = methods_of(row.spec);
  if (methods.size() < kMethodNames.size()) schema["x-methods"] = methods;
  return schema;
}

json light_schema(std::size_t type) {
  json properties = json::object();
  for (const auto& row : light_rows())
    if (uses(row.spec, static_cast<LightType>(type)))
      properties[std::string(row.spec.path)] = row_schema(row);
  const SettingSpec& spec = light_rows().front().spec;
  properties["type"] = {{"const", std::string(spec.choices[type])},
                        {"description", std::string(spec.description)}};
  json schema = closed_object(std::move(properties));
  schema["required"] = {"type"};
  return schema;
}

json lights_schema() {
  json kinds = json::array();
  for (std::size_t t = 0; t < light_rows().front().spec.choices.size(); ++t)
    kinds.push_back(light_schema(t));
  return {{"type", "array"},
          {"description",
           "Lights beside those of the scene. Coordinates are world space in meters, +Y up. "
           "inner_cone_angle may not "
           "be more than outer_cone_angle."},
          {"default", json::array()},
          {"maxItems", kMaxLights},
          {"items", {{"oneOf", std::move(kinds)}}}};
}

/// Finds settings that are right each for itself, but not together.
void check_together(const BakeSettings& s, ProblemList& problems) {
  if (2 * s.atlas.gutter >= s.atlas.page_size)
    problems.add("/atlas/gutter", "expected less than half of page_size (" +
                                      std::to_string(s.atlas.page_size) + "), found " +
                                      std::to_string(s.atlas.gutter));
  const SolverSettings& solver = s.solver;
  const bool all_send =
      solver.undersampling == Undersampling::kNone && !solver.subdivision_threshold;
  if (solver.iteration == Iteration::kShooting && !all_send)
    problems.add("/solver/iteration",
                 "texels shoot their own light: expected \"jacobi\" or \"gauss_seidel\" with "
                 "undersampling or subdivision_threshold");
  if (solver.visibility == VisibilityKind::kCached &&
      (solver.pair_samples > 1 || solver.undersampling == Undersampling::kMipmap ||
       solver.subdivision_threshold))
    problems.add("/solver/visibility",
                 "a bit is remembered for the middles of two texels: expected \"ray\" or \"voxel\" "
                 "with pair_samples above 1, undersampling \"mipmap\" or subdivision_threshold");
  if (solver.method == Method::kLinks && solver.visibility == VisibilityKind::kCached)
    problems.add("/solver/visibility",
                 "links change from bounce to bounce, and no bit is remembered for them: expected "
                 "\"ray\" or \"voxel\" with method \"links\"");
  check_directional(solver, problems);
  if (solver.subdivision_threshold && solver.undersampling != Undersampling::kNone)
    problems.add("/solver/subdivision_threshold",
                 "senders are the leaves of a quadtree or those of windows: expected null with "
                 "undersampling, or undersampling \"none\"");
  check_output(s, problems);
}

}  // namespace

Expected<BakeSettings> settings_from_json(const json& doc) {
  ProblemList problems("settings");
  BakeSettings out;
  const auto top_rows = rows_of("", setting_rows());
  std::vector<std::string_view> known{"lights"};
  for (const auto& group : setting_groups()) known.push_back(group.name);
  for (const auto& [name, row] : top_rows) known.push_back(name);

  if (!doc.is_object()) {
    problems.add("", "expected an object, found " + brief_value(doc));
    return Unexpected(std::move(problems).error("invalid_settings"));
  }
  const auto& groups = setting_groups();
  for (const auto& [key, value] : doc.items()) {
    const auto is_group = [&name = key](const SettingGroup& g) { return g.name == name; };
    if (key == "lights")
      read_lights(value, out, problems);
    else if (std::any_of(groups.begin(), groups.end(), is_group))
      read_group(key, value, out, problems);
    else if (!read_key(top_rows, "", key, value, out, problems))
      unknown_key("", key, known, problems);
  }
  check_together(out, problems);
  if (!problems.empty()) return Unexpected(std::move(problems).error("invalid_settings"));
  return out;
}

Expected<BakeSettings> parse_settings(std::string_view text) {
  if (text.empty()) return BakeSettings{};
  auto doc = parse_json(text, "settings");
  if (!doc) return Unexpected(std::move(doc.error()));
  return settings_from_json(*doc);
}

json to_json(const BakeSettings& settings) {
  json doc = json::object();
  for (const auto& group : setting_groups())
    for (const auto& [name, row] : rows_of(group.name, setting_rows()))
      doc[std::string(group.name)][std::string(name)] = row->read(settings, row->spec);
  for (const auto& [name, row] : rows_of("", setting_rows()))
    doc[std::string(name)] = row->read(settings, row->spec);
  doc["lights"] = json::array();
  for (const auto& light : settings.lights) doc["lights"].push_back(light_json(light));
  return doc;
}

json settings_schema() {
  json properties = json::object();
  for (const auto& group : setting_groups()) {
    json members = json::object();
    for (const auto& [name, row] : rows_of(group.name, setting_rows()))
      members[std::string(name)] = row_schema(*row);
    properties[std::string(group.name)] = closed_object(std::move(members));
    properties[std::string(group.name)]["description"] = std::string(group.description);
  }
  for (const auto& [name, row] : rows_of("", setting_rows()))
    properties[std::string(name)] = row_schema(*row);
  properties["lights"] = lights_schema();
  json schema = closed_object(std::move(properties));
  schema["$schema"] = "https://json-schema.org/draft/2020-12/schema";
  schema["$id"] = "urn:lightkiln:settings";
  schema["title"] = "Settings of a bake";
  schema["description"] = "Every key may be left out; null is allowed where a type says so.";
  return schema;
}

}  // namespace kiln::proto
