#include "baker/import/import.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"
#include "baker/import/cameras.h"
#include "baker/import/graph.h"
#include "baker/import/images.h"
#include "baker/import/lights.h"
#include "baker/import/materials.h"
#include "baker/import/sky_map.h"
#include "baker/import/world_primitive.h"
#include "baker/scene/scene_file.h"
#include "proto/sha256.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;

/// Holds materials in the order of their first use.
class MaterialTable {
 public:
  explicit MaterialTable(gltf::Document& document) : document_(document) {}

  std::uint32_t index_of(std::int32_t gltf_material) {
    const auto [found, is_new] =
        index_.try_emplace(gltf_material, static_cast<std::uint32_t>(sources_.size()));
    if (is_new) sources_.push_back(read_material(document_, gltf_material));
    return found->second;
  }
  const MaterialSource& at(std::uint32_t i) const { return sources_[i]; }

  std::vector<scene::Material> materials() const {
    std::vector<scene::Material> out;
    for (const MaterialSource& source : sources_) out.push_back(source.material);
    return out;
  }

 private:
  gltf::Document& document_;
  std::map<std::int32_t, std::uint32_t> index_;
  std::vector<MaterialSource> sources_;
};

/// The state that import and check share: both walk over all primitives of all placed nodes.
struct Import {
  Import(gltf::Document& d, const files::ImportLimits& limits, std::stop_token s)
      : document(d),
        accessors(d, s),
        materials(d),
        budget(limits),
        stop(s),
        stopped(std::move(s)) {}

  gltf::Document& document;
  gltf::Accessors accessors;
  MaterialTable materials;
  GeometryBudget budget;
  std::stop_token stop;
  exec::StopPoll stopped;
  bool emissive = false;  ///< a triangle that is kept has an emissive material

  void note_dropped(const WorldPrimitive& world, const std::string& pointer) {
    if (world.degenerate > 0) {
      document.warnings.add("degenerate_triangles", pointer, "triangles without area are left out",
                            world.degenerate);
    }
    if (world.broken_normals > 0) {
      document.warnings.add("normals_repaired", pointer,
                            "normals without a direction were replaced by those of the faces",
                            world.broken_normals);
    }
  }
};

/// Returns the name of an instance, from its node or else its mesh.
std::string instance_name(const tinygltf::Model& model, std::uint32_t node, std::uint32_t mesh) {
  return model.nodes[node].name.empty() ? model.meshes[mesh].name : model.nodes[node].name;
}

/// Reads an attribute for each vertex of a part; `fallback` where the primitive has none.
template <class T, class Read>
void append(std::vector<T>& to, const std::optional<gltf::AccessorView>& view,
            const std::vector<std::uint32_t>& source_vertex, T fallback, exec::StopPoll& stopped,
            Read read) {
  const std::size_t size = to.size() + source_vertex.size();
  if (size > to.capacity()) to.reserve(std::max(size, 2 * to.capacity()));
  for (const std::uint32_t v : source_vertex) {
    if (stopped()) return;
    to.push_back(view ? read(view->floats(v)) : fallback);
  }
}

std::optional<gltf::AccessorView> uv_set(const PrimitiveSource& source, std::uint32_t set) {
  const auto found = source.uv_sets.find(set);
  return found == source.uv_sets.end() ? std::nullopt : std::optional(found->second);
}

/// Appends the texture coordinates of one texture for each vertex of a part.
void append_uv(std::vector<math::Vec2>& to, Import& import, const PrimitiveSource& source,
               const std::vector<std::uint32_t>& vertices, const UvSource& uv, bool is_used) {
  const auto view = is_used ? uv_set(source, uv.set) : std::nullopt;
  if (is_used && !view) {
    import.document.warnings.add("texcoord_missing", source.pointer,
                                 "a texture needs TEXCOORD_" + std::to_string(uv.set) +
                                     ", which the primitive has not: its corner texel is used");
  }
  append(to, view, vertices, math::Vec2{}, import.stopped, [&](const std::array<float, 4>& v) {
    return uv.apply({v[0], v[1]});
  });
}

/// Appends a part to the scene. When stopped, the part may lack some of its vertices.
void append_part(scene::Scene& scene, Import& import, const PrimitiveSource& source,
                 WorldPrimitive world, std::uint32_t primitive, std::uint32_t material) {
  scene::Part part;
  part.instance = static_cast<std::uint32_t>(scene.instances.size());
  part.primitive = primitive;
  part.material = material;
  part.first_vertex = static_cast<std::uint32_t>(scene.positions.size());
  part.vertex_count = static_cast<std::uint32_t>(world.positions.size());
  part.first_triangle = static_cast<std::uint32_t>(scene.triangles.size());
  part.triangle_count = static_cast<std::uint32_t>(world.triangles.size());
  part.has_lightmap_uv = source.uv_sets.contains(1);
  const MaterialSource& m = import.materials.at(material);
  const auto& vertices = world.source_vertex;
  append_uv(scene.base_uv, import, source, vertices, m.base_uv, m.material.base_texture.image >= 0);
  append_uv(scene.emission_uv, import, source, vertices, m.emission_uv,
            m.material.emission_texture.image >= 0);
  append(scene.lightmap_uv, uv_set(source, 1), vertices, math::Vec2{}, import.stopped,
         [](const std::array<float, 4>& v) {
           return math::Vec2{v[0], v[1]};
         });
  const bool has_alpha = source.colors && source.colors->components == 4;
  append(scene.colors, source.colors, vertices, std::array<float, 4>{1, 1, 1, 1}, import.stopped,
         [&](std::array<float, 4> v) {
           if (!has_alpha) v[3] = 1;
           return v;
         });
  scene.positions.insert(scene.positions.end(), world.positions.begin(), world.positions.end());
  scene.normals.insert(scene.normals.end(), world.normals.begin(), world.normals.end());
  scene.source_vertex.insert(scene.source_vertex.end(), vertices.begin(), vertices.end());
  for (const auto& t : world.triangles) {
    scene.triangles.push_back(
        {part.first_vertex + t[0], part.first_vertex + t[1], part.first_vertex + t[2]});
  }
  scene.triangle_part.insert(scene.triangle_part.end(), world.triangles.size(),
                             static_cast<std::uint32_t>(scene.parts.size()));
  scene.parts.push_back(part);
}

/// Appends all parts of one node's mesh; no instance when nothing is left of it.
Expected<void> append_instance(scene::Scene& scene, Import& import, const PlacedNode& placed,
                               std::uint32_t mesh) {
  const auto& model = *import.document.model;
  const auto& primitives = model.meshes[mesh].primitives;
  scene::Instance instance{placed.node,
                           mesh,
                           instance_name(model, placed.node, mesh),
                           static_cast<std::uint32_t>(scene.parts.size()),
                           0,
                           placed.to_world.determinant() < 0};
  for (std::uint32_t p = 0; p < primitives.size(); ++p) {
    const auto source =
        open_primitive(import.document, import.accessors, mesh, p, import.budget, import.stop);
    if (!source) return Unexpected(source.error());
    if (!*source) continue;
    auto world = place_primitive(**source, placed.to_world, import.stop);
    if (!world) return Unexpected(world.error());
    import.note_dropped(*world, (*source)->pointer);
    if (world->triangles.empty()) continue;
    const std::uint32_t material = import.materials.index_of(primitives[p].material);
    append_part(scene, import, **source, std::move(*world), p, material);
    if (import.stop.stop_requested()) return exec::canceled();
    ++instance.part_count;
  }
  if (instance.part_count > 0) scene.instances.push_back(std::move(instance));
  return {};
}

void warn_of_node(gltf::Document& document, const tinygltf::Node& node, std::uint32_t index) {
  if (node.skin >= 0) {
    document.warnings.add("skin_ignored", gltf::pointer_to("/nodes", index) + "/skin",
                          "skins are not applied: the mesh is baked unskinned at its node");
  }
}

/// Does one primitive's part of a check. `settled` holds the primitives that are known to leave
/// triangles: their further instances need no look, only their share of the budget.
Expected<void> check_primitive(Import& import, const PlacedNode& placed, std::uint32_t mesh,
                               std::uint32_t primitive,
                               std::map<std::pair<std::uint32_t, std::uint32_t>,
                                        std::pair<std::uint64_t, std::uint64_t>>& settled) {
  if (const auto known = settled.find({mesh, primitive}); known != settled.end()) {
    return import.budget.take(known->second.first, known->second.second,
                              gltf::pointer_to("/nodes", placed.node));
  }
  const auto source = open_primitive(import.document, import.accessors, mesh, primitive,
                                     import.budget, import.stop);
  if (!source) return Unexpected(source.error());
  if (!*source) return {};
  const auto any = has_triangles(**source, placed.to_world, import.stop);
  if (!any) return Unexpected(any.error());
  if (!*any) return {};
  const auto material =
      import.materials.index_of(import.document.model->meshes[mesh].primitives[primitive].material);
  import.emissive |= !is_black(import.materials.at(material).material.emission);
  settled[{mesh, primitive}] = {(*source)->vertex_bound, (*source)->triangle_count};
  return {};
}

Unexpected nothing_to_bake() {
  return proto::fail("nothing_to_bake", "the scene shows no triangle that has an area", "scene",
                     "");
}

/// Says whether any triangle is left.
Expected<bool> check_geometry(Import& import, const std::vector<PlacedNode>& placed) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::pair<std::uint64_t, std::uint64_t>>
      settled;
  for (const PlacedNode& node : placed) {
    const int mesh = import.document.model->nodes[node.node].mesh;
    if (mesh < 0) continue;
    const auto m = static_cast<std::uint32_t>(mesh);
    for (std::uint32_t p = 0; p < import.document.model->meshes[m].primitives.size(); ++p) {
      if (auto checked = check_primitive(import, node, m, p, settled); !checked) {
        return Unexpected(checked.error());
      }
    }
  }
  return !settled.empty();
}

proto::Expected<void> append_geometry(scene::Scene& scene, Import& import,
                                      const std::vector<PlacedNode>& placed) {
  for (const PlacedNode& node : placed) {
    const auto& source = import.document.model->nodes[node.node];
    warn_of_node(import.document, source, node.node);
    if (source.mesh < 0) continue;
    auto appended = append_instance(scene, import, node, static_cast<std::uint32_t>(source.mesh));
    if (!appended) return appended;
  }
  if (scene.triangles.empty()) return nothing_to_bake();
  return {};
}

}  // namespace

struct OpenedScene::Parts {
  Parts(gltf::Document d, std::vector<PlacedNode> p, const files::ImportLimits& l)
      : document(std::move(d)), placed(std::move(p)), limits(l) {}

  gltf::Document document;
  std::vector<PlacedNode> placed;
  files::ImportLimits limits;
};

OpenedScene::OpenedScene(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
OpenedScene::OpenedScene(OpenedScene&&) noexcept = default;
OpenedScene::~OpenedScene() = default;

proto::Expected<OpenedScene> OpenedScene::open(const files::SceneFiles& files,
                                               const files::ImportLimits& limits,
                                               const std::stop_token& stop) {
  auto document = gltf::open_document(files, limits, stop);
  if (!document) return Unexpected(document.error());
  auto placed = place_nodes(*document, limits, stop);
  if (!placed) return Unexpected(placed.error());
  return OpenedScene(std::make_unique<Parts>(std::move(*document), std::move(*placed), limits));
}

proto::Expected<void> OpenedScene::check(const proto::BakeSettings& settings,
                                         const std::stop_token& stop) {
  auto& [document, placed, limits] = *parts_;
  const gltf::WarningList before = document.warnings;
  Import import(document, limits, stop);
  const auto has_triangles = check_geometry(import, placed);
  // The import that follows gives these warnings itself.
  document.warnings = before;
  if (!has_triangles) return Unexpected(has_triangles.error());
  if (!*has_triangles) return nothing_to_bake();
  scene::Scene lights;
  if (settings.sky.map) {
    if (auto found = check_sky_map(document, *settings.sky.map, limits); !found) return found;
    lights.sky_map = {2, 1, {{1, 1, 1}, {1, 1, 1}}};  // what it shows is not known yet
  }
  if (settings.report.against && !settings.report.method()) {
    const auto file =
        document.files.named_file(*settings.report.against, "settings", "/report/against");
    if (!file) return Unexpected(file.error());
  }
  if (auto added = add_punctual_lights(lights, document, placed, limits); !added) return added;
  if (auto added = add_settings_lights(lights, settings, stop); !added) return added;
  if (auto lit = require_light(lights, import.emissive, settings); !lit) return lit;
  return find_images(document, import.materials.materials());
}

proto::Expected<scene::Scene> OpenedScene::import(const std::optional<std::string>& sky_map,
                                                  const std::stop_token& stop) {
  auto& [document, placed, limits] = *parts_;
  Import import(document, limits, stop);
  scene::Scene scene;
  if (auto done = append_geometry(scene, import, placed); !done) return Unexpected(done.error());
  if (auto done = add_punctual_lights(scene, document, placed, limits); !done) {
    return Unexpected(done.error());
  }
  add_cameras(scene, document, placed);
  scene.materials = import.materials.materials();
  if (auto done = load_images(document, scene, limits, stop); !done)
    return Unexpected(done.error());
  if (sky_map)
    if (auto done = load_sky_map(document, scene, *sky_map, limits, stop); !done)
      return Unexpected(done.error());
  if (document.has_animations) {
    document.warnings.add("animation_ignored", "/animations", "the scene is baked at rest");
  }
  scene.warnings = document.warnings.take();
  return scene;
}

proto::Expected<void> check_scene(const files::SceneFiles& files,
                                  const proto::BakeSettings& settings,
                                  const files::ImportLimits& limits, std::stop_token stop) {
  auto opened = OpenedScene::open(files, limits, stop);
  if (!opened) return Unexpected(opened.error());
  return opened->check(settings, stop);
}

proto::Expected<scene::Scene> import_files(const files::SceneFiles& files,
                                           const files::ImportLimits& limits,
                                           std::stop_token stop) {
  auto opened = OpenedScene::open(files, limits, stop);
  if (!opened) return Unexpected(opened.error());
  return opened->import(files.sky_map, stop);
}

proto::Expected<void> apply_settings(scene::Scene& scene, const proto::BakeSettings& settings,
                                     std::stop_token stop) {
  if (auto added = add_settings_lights(scene, settings, stop); !added) return added;
  const bool emissive = std::any_of(
      scene.parts.begin(), scene.parts.end(),
      [&](const scene::Part& part) { return !is_black(scene.materials[part.material].emission); });
  return require_light(scene, emissive, settings);
}

proto::Expected<scene::Scene> import_scene(const files::SceneFiles& files,
                                           const proto::BakeSettings& settings,
                                           const files::ImportLimits& limits,
                                           std::stop_token stop) {
  files::SceneFiles with_sky = files;
  with_sky.sky_map = settings.sky.map;
  auto scene = import_files(with_sky, limits, stop);
  if (!scene) return scene;
  if (auto applied = apply_settings(*scene, settings, stop); !applied)
    return Unexpected(applied.error());
  return scene;
}

std::string import_key(const std::string& scene_key, const files::ImportLimits& limits,
                       const std::optional<std::string>& sky_map) {
  std::string text =
      LIGHTKILN_VERSION "\n" + std::to_string(scene::kSceneFileVersion) + "\n" + scene_key + "\n";
  for (const std::uint64_t limit :
       {limits.file_bytes, limits.json_bytes, std::uint64_t{limits.json_depth},
        std::uint64_t{limits.nodes}, std::uint64_t{limits.node_depth}, limits.vertices,
        limits.triangles, limits.image_pixels, limits.all_image_pixels,
        std::uint64_t{limits.lights}})
    text += std::to_string(limit) + "\n";
  if (sky_map) text += "sky map " + *sky_map + "\n";
  return proto::sha256_hex(text);
}

}  // namespace kiln::import
