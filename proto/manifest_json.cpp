#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"
#include "proto/json_reader.h"
#include "proto/json_values.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

constexpr std::uint32_t kManifestVersion = 1;

json number(float v) {
  return shortest_number(v);
}
json pair(const std::array<float, 2>& v) {
  return json::array({number(v[0]), number(v[1])});
}

template <class T, class One>
json list(const std::vector<T>& items, const One& one) {
  json out = json::array();
  for (const auto& item : items) out.push_back(one(item));
  return out;
}

json file_json(const ResultFile& f) {
  return {{"name", f.name}, {"media_type", f.media_type}, {"bytes", f.bytes}, {"sha256", f.sha256}};
}

json page_json(const PageInfo& p) {
  return {{"width", p.width},
          {"height", p.height},
          {"texels", p.texels},
          {"exr", p.exr},
          {"preview", p.preview},
          {"preview_exposure", number(p.preview_exposure)},
          {"max_lx", number(p.max_lx)},
          {"glb_scale", number(p.glb_scale)},
          {"glb_clipped", p.glb_clipped},
          {"glb_clipped_lamps", p.glb_clipped_lamps}};
}

json node_json(const NodePlacement& n) {
  return {{"node", n.node},           {"mesh", n.mesh},         {"name", n.name},
          {"page", n.page},           {"scale", pair(n.scale)}, {"offset", pair(n.offset)},
          {"uv_source", n.uv_source}, {"reason", n.reason}};
}

json stage_json(const StageReport& s) {
  return {{"name", s.name}, {"seconds", s.seconds}};
}

json statistics_json(const Statistics& s) {
  return {{"triangles", s.triangles},
          {"instances", s.instances},
          {"emissive_triangles", s.emissive_triangles},
          {"punctual_lights", s.punctual_lights},
          {"texels", s.texels},
          {"charts", s.charts},
          {"rays", s.rays},
          {"albedo_capped_texels", s.albedo_capped_texels},
          {"invalid_texels", s.invalid_texels},
          {"texels_per_metre", s.texels_per_metre},
          {"tail_scale", s.tail_scale},
          {"standard_error", or_null(s.standard_error)},
          {"ray_pattern", s.ray_pattern},
          {"memory_estimate_bytes", s.memory_estimate_bytes},
          {"peak_memory_bytes", s.peak_memory_bytes},
          {"stages", list(s.stages, stage_json)},
          {"passes", list(s.passes, [](const PassReport& p) { return to_json(p); })}};
}

void read_pass(JsonReader& in, PassReport& out) {
  in.read("name", out.name);
  in.read("index", out.index);
  in.read("residual", out.residual);
  in.read("mean_lx", out.mean_lx);
  in.read("seconds", out.seconds);
  in.read("rays", out.rays);
  in.read("standard_error", out.standard_error);
}

void read_statistics(JsonReader in, Statistics& out) {
  in.read("triangles", out.triangles);
  in.read("instances", out.instances);
  in.read("emissive_triangles", out.emissive_triangles);
  in.read("punctual_lights", out.punctual_lights);
  in.read("texels", out.texels);
  in.read("charts", out.charts);
  in.read("rays", out.rays);
  in.read("albedo_capped_texels", out.albedo_capped_texels);
  in.read("invalid_texels", out.invalid_texels);
  in.read("texels_per_metre", out.texels_per_metre);
  in.read("tail_scale", out.tail_scale);
  in.read("ray_pattern", out.ray_pattern);
  in.read("standard_error", out.standard_error);
  in.read("memory_estimate_bytes", out.memory_estimate_bytes);
  in.read("peak_memory_bytes", out.peak_memory_bytes);
  in.read_list("stages", out.stages, [](JsonReader& item, StageReport& s) {
    item.read("name", s.name);
    item.read("seconds", s.seconds);
  });
  in.read_list("passes", out.passes, read_pass);
}

void read_page(JsonReader& in, PageInfo& out) {
  in.read("width", out.width);
  in.read("height", out.height);
  in.read("texels", out.texels);
  in.read("exr", out.exr);
  in.read("preview", out.preview);
  in.read("preview_exposure", out.preview_exposure);
  in.read("max_lx", out.max_lx);
  in.read_if_there("glb_scale", out.glb_scale);  // Manifests of 0.2 lack these three.
  in.read_if_there("glb_clipped", out.glb_clipped);
  in.read_if_there("glb_clipped_lamps", out.glb_clipped_lamps);
}

void read_node(JsonReader& in, NodePlacement& out) {
  in.read("node", out.node);
  in.read("mesh", out.mesh);
  in.read("name", out.name);
  in.read("page", out.page);
  in.read("scale", out.scale);
  in.read("offset", out.offset);
  in.read("uv_source", out.uv_source);
  in.read("reason", out.reason);
}

void read_file(JsonReader& in, ResultFile& out) {
  in.read("name", out.name);
  in.read("media_type", out.media_type);
  in.read("bytes", out.bytes);
  in.read("sha256", out.sha256);
}

void read_warning(JsonReader& in, Warning& out) {
  in.read("code", out.code);
  in.read("pointer", out.pointer);
  in.read("message", out.message);
}

void read_settings(JsonReader& in, BakeSettings& out, ProblemList& problems) {
  const auto* doc = in.find("settings");
  if (doc == nullptr) return;
  auto settings = settings_from_json(*doc);
  if (settings) {
    out = std::move(*settings);
    return;
  }
  for (auto& place : settings.error().details)
    problems.add("/settings" + place.pointer, std::move(place.detail));
}

}  // namespace

json to_json(const PassReport& p) {
  return {{"name", p.name},
          {"index", p.index},
          {"residual", p.residual},
          {"mean_lx", p.mean_lx},
          {"seconds", p.seconds},
          {"rays", p.rays},
          {"standard_error", or_null(p.standard_error)}};
}

json to_json(const Warning& w) {
  return {{"code", w.code}, {"pointer", w.pointer}, {"message", w.message}};
}

json to_json(const Manifest& m) {
  return {{"manifest_version", kManifestVersion},
          {"version", m.version},
          {"scene_sha256", m.scene_sha256},
          {"instruction_set", m.instruction_set},
          {"units", {{"texel", "lx"}, {"length", "m"}}},
          {"settings", to_json(m.settings)},
          {"pages", list(m.pages, page_json)},
          {"nodes", list(m.nodes, node_json)},
          {"files", list(m.files, file_json)},
          {"statistics", statistics_json(m.statistics)},
          {"warnings", list(m.warnings, [](const Warning& w) { return to_json(w); })}};
}

Expected<PassReport> pass_report_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  PassReport out;
  read_pass(in, out);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

Expected<std::vector<ResultFile>> result_files_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  std::vector<ResultFile> out;
  in.read_list("files", out, read_file);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

Expected<Manifest> manifest_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  Manifest out;
  std::uint32_t version = kManifestVersion;
  in.read("manifest_version", version);
  if (version != kManifestVersion)
    problems.add("/manifest_version", "expected 1, found " + std::to_string(version));
  in.read("version", out.version);
  in.read("scene_sha256", out.scene_sha256);
  in.read("instruction_set", out.instruction_set);
  read_settings(in, out.settings, problems);
  in.read_list("pages", out.pages, read_page);
  in.read_list("nodes", out.nodes, read_node);
  in.read_list("files", out.files, read_file);
  read_statistics(in.child("statistics"), out.statistics);
  in.read_list("warnings", out.warnings, read_warning);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

}  // namespace kiln::proto
