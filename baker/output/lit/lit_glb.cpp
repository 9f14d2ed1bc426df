#include "baker/output/lit/lit_glb.h"

#include <fcntl.h>

#include <nlohmann/json.hpp>
#include <set>

#include "baker/output/lit/document.h"
#include "baker/output/lit/geometry.h"
#include "baker/output/lit/lights.h"
#include "baker/output/lit/materials.h"
#include "proto/files.h"

namespace kiln::output::lit {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr int kTriangles = 4;

/// These extensions of a primitive refer to its source's indices or order of triangles.
constexpr const char* kOrderExtensions[] = {"FB_ngon_encoding", "CESIUM_primitive_outline"};
constexpr const char* kDraco = "KHR_draco_mesh_compression";

/// Calls visit(Json& index) for the primitive's material and those of KHR_materials_variants.
template <class Visit>
void for_materials(Json& primitive, Visit visit) {
  if (primitive.contains("material")) visit(primitive["material"]);
  const Json::json_pointer mappings("/extensions/KHR_materials_variants/mappings");
  if (!primitive.contains(mappings) || !primitive[mappings].is_array()) return;
  for (Json& mapping : primitive[mappings])
    if (mapping.is_object() && mapping.contains("material")) visit(mapping["material"]);
}

/// Returns the number of the first free set of texture coordinates beyond 1.
std::uint32_t free_texcoord(const Json& attributes) {
  std::uint32_t set = 2;
  while (attributes.contains("TEXCOORD_" + std::to_string(set))) ++set;
  return set;
}

void rename(Json& attributes, const char* from, const std::string& to) {
  const auto found = attributes.find(from);
  if (found == attributes.end()) return;
  Json value = *found;
  attributes.erase(from);
  attributes[to] = std::move(value);
}

class LitScene {
 public:
  LitScene(LitDocument& document, const scene::Scene& scene, const atlas::Atlas& atlas,
           const LitPages& light)
      : document_(document),
        scene_(scene),
        atlas_(atlas),
        meshes_(document.json().value("meshes", Json::array())),
        writer_(document),
        materials_(document, light, materials_without_light()) {}

  proto::Expected<void> build() {
    std::set<std::uint64_t> in_place = meshes_of_instances_only();
    for (std::uint32_t i = 0; i < scene_.instances.size(); ++i) {
      const scene::Instance& instance = scene_.instances[i];
      if (instance.part_count == 0) continue;
      auto mesh = lit_mesh(i);
      if (!mesh) return Unexpected(mesh.error());
      Json& node = document_.json()["nodes"].at(instance.node);
      if (in_place.erase(instance.mesh))
        document_.json()["meshes"][instance.mesh] = std::move(*mesh);
      else
        node["mesh"] = document_.add("meshes", std::move(*mesh));
      materials_.mark_node(node, atlas_.placements[i].page);
    }
    describe_pages();
    return {};
  }

 private:
  /// Adds what loaders need beyond the extensions, unless the source's extras are no object.
  void describe_pages() {
    Json& asset = document_.json()["asset"];
    if (asset.contains("extras") && !asset["extras"].is_object()) return;
    Json described = materials_.describe();
    described["version"] = LIGHTKILN_VERSION;
    asset["extras"]["lightkiln"] = std::move(described);
  }

  bool is_lit(std::uint32_t instance, std::size_t primitive) const {
    const scene::Instance& in = scene_.instances[instance];
    for (std::uint32_t p = in.first_part; p < in.first_part + in.part_count; ++p)
      if (scene_.parts[p].primitive == primitive) return true;
    return false;
  }

  /// Returns the instances by mesh, -1 for nodes that are none (outside the scene, or nothing to
  /// bake).
  std::map<std::uint64_t, std::vector<std::int64_t>> users_of_meshes() const {
    std::map<std::uint64_t, std::int64_t> instance_of;
    for (std::size_t i = 0; i < scene_.instances.size(); ++i)
      if (scene_.instances[i].part_count) instance_of[scene_.instances[i].node] = std::int64_t(i);
    std::map<std::uint64_t, std::vector<std::int64_t>> users;
    const Json& nodes = document_.json()["nodes"];
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      const auto mesh = count_at(nodes[n], "mesh", meshes_.size());
      if (!mesh || *mesh >= meshes_.size()) continue;
      const auto found = instance_of.find(n);
      users[*mesh].push_back(found == instance_of.end() ? -1 : found->second);
    }
    return users;
  }

  /// Returns the meshes whose own place may hold the first instance's: nothing else shows them.
  std::set<std::uint64_t> meshes_of_instances_only() const {
    std::set<std::uint64_t> out;
    for (const auto& [mesh, users] : users_of_meshes())
      if (std::find(users.begin(), users.end(), -1) == users.end()) out.insert(mesh);
    return out;
  }

  std::set<std::uint64_t> materials_without_light() {
    const auto users = users_of_meshes();
    std::set<std::uint64_t> out;
    for (std::size_t m = 0; m < meshes_.size(); ++m) {
      const auto found = users.find(m);
      Json& primitives = meshes_[m]["primitives"];
      for (std::size_t p = 0; p < primitives.size(); ++p) {
        bool lit = found != users.end();
        if (lit)
          for (const std::int64_t i : found->second)
            lit = lit && i >= 0 && is_lit(std::uint32_t(i), p);
        if (lit) continue;
        for_materials(primitives[p], [&](const Json& material) {
          if (const auto index = as_count(material)) out.insert(*index);
        });
      }
    }
    return out;
  }

  /// Returns a copy of the instance's mesh with its parts lit.
  proto::Expected<Json> lit_mesh(std::uint32_t instance_index) {
    const scene::Instance& instance = scene_.instances[instance_index];
    Json mesh = meshes_.at(instance.mesh);
    Json primitives = Json::array();
    std::uint32_t part = instance.first_part;
    const std::uint32_t end = part + instance.part_count;
    for (std::size_t p = 0; p < mesh["primitives"].size(); ++p) {
      const Json& source = mesh["primitives"][p];
      if (part == end || scene_.parts[part].primitive != p) {
        primitives.push_back(source);
        continue;
      }
      if (auto ok = add_lit(primitives, source, part++); !ok) return Unexpected(ok.error());
    }
    mesh["primitives"] = std::move(primitives);
    return mesh;
  }

  proto::Expected<void> add_lit(Json& out, const Json& source, std::uint32_t part) {
    const auto position = count_at(source.at("attributes"), "POSITION", ~std::uint64_t{0});
    const auto values = document_.accessor(position.value_or(~std::uint64_t{0}));
    if (!values) return Unexpected(values.error());
    for (const LitPiece& piece : cut_part(scene_, atlas_, part, values->count)) {
      Json primitive = source;
      drop_extension(primitive, kDraco);  // its decoders order vertices anew
      if (auto ok = light(primitive, piece, part); !ok) return ok;
      out.push_back(std::move(primitive));
    }
    return {};
  }

  /// Says whether TEXCOORD_1 already is the place on the page.
  bool keeps_uv(const Json& attributes, const LitPiece& piece, std::uint32_t part) const {
    const atlas::InstancePlacement& placed = atlas_.placements[scene_.parts[part].instance];
    return piece.keeps_vertices && placed.uses_source_uv && placed.scale == math::Vec2{1, 1} &&
           placed.offset == math::Vec2{0, 0} && attributes.contains("TEXCOORD_1");
  }

  proto::Expected<void> light(Json& primitive, const LitPiece& piece, std::uint32_t part) {
    std::uint32_t set = 1;
    if (!keeps_uv(primitive["attributes"], piece, part)) {
      set = move_texcoord_1(primitive);
      if (!piece.keeps_vertices)
        if (auto ok = rebuild(primitive, piece); !ok) return ok;
      primitive["attributes"]["TEXCOORD_1"] = writer_.uv(piece.uv);
    }
    // Sets are numbered without gaps: a first one that nothing reads.
    Json& attributes = primitive["attributes"];
    if (materials_.hold_albedo()) drop_colors(primitive);
    const Json lightmap_uv = attributes.at("TEXCOORD_1");
    if (!attributes.contains("TEXCOORD_0")) attributes["TEXCOORD_0"] = lightmap_uv;
    if (!primitive.contains("material"))
      primitive["material"] = materials_.variant(std::nullopt, piece.page, set);
    else
      for_materials(primitive,
                    [&](Json& m) { m = materials_.variant(as_count(m), piece.page, set); });
    return {};
  }

  /// Takes the vertex colors off, which would multiply what the page has of them already.
  static void drop_colors(Json& primitive) {
    const auto drop = [](Json& attributes) {
      for (std::uint32_t set = 0; attributes.erase("COLOR_" + std::to_string(set)) != 0; ++set) {
      }
    };
    drop(primitive["attributes"]);
    if (primitive.contains("targets"))
      for (Json& target : primitive["targets"]) drop(target);
  }

  /// Makes room for the lightmap. Returns the set that the source's TEXCOORD_1 moved to, or 1 where
  /// no texture reads it and it was left out.
  std::uint32_t move_texcoord_1(Json& primitive) {
    bool wanted = false;
    for_materials(primitive, [&](const Json& m) {
      wanted = wanted || materials_.reads_texcoord_1(as_count(m));
    });
    const std::uint32_t set = wanted ? free_texcoord(primitive["attributes"]) : 1;
    const auto move = [&](Json& attributes) {
      if (wanted)
        rename(attributes, "TEXCOORD_1", "TEXCOORD_" + std::to_string(set));
      else
        attributes.erase("TEXCOORD_1");
    };
    move(primitive["attributes"]);
    if (primitive.contains("targets"))
      for (Json& target : primitive["targets"]) move(target);
    return set;
  }

  proto::Expected<void> rebuild(Json& primitive, const LitPiece& piece) {
    const auto gather = [&](Json& attributes) -> proto::Expected<void> {
      for (auto& [name, accessor] : attributes.items()) {
        const auto made =
            writer_.gather(as_count(accessor).value_or(~std::uint64_t{0}), piece.source);
        if (!made) return Unexpected(made.error());
        accessor = *made;
      }
      return {};
    };
    if (auto ok = gather(primitive["attributes"]); !ok) return ok;
    if (primitive.contains("targets"))
      for (Json& target : primitive["targets"])
        if (auto ok = gather(target); !ok) return ok;
    primitive["indices"] = writer_.indices(piece.indices, piece.source.size());
    if (primitive.contains("mode")) primitive["mode"] = kTriangles;
    for (const char* name : kOrderExtensions) drop_extension(primitive, name);
    return {};
  }

  LitDocument& document_;
  const scene::Scene& scene_;
  const atlas::Atlas& atlas_;
  Json meshes_;  ///< meshes of the source
  AccessorWriter writer_;
  LitMaterials materials_;
};

bool uses_draco(const Json& document) {
  for (const Json& mesh : document.value("meshes", Json::array()))
    for (const Json& primitive : mesh.value("primitives", Json::array()))
      if (primitive.contains(Json::json_pointer(std::string("/extensions/") + kDraco))) return true;
  return false;
}

void list_extensions(Json& document, const std::vector<const char*>& added) {
  Json& used = document["extensionsUsed"];
  if (!used.is_array()) used = Json::array();
  const bool draco = uses_draco(document);
  const auto without_draco = [&](const Json& names) {
    Json kept = Json::array();
    for (const Json& name : names)
      if (draco || name != kDraco) kept.push_back(name);
    return kept;
  };
  Json kept = without_draco(used);
  for (const char* name : added)
    if (std::find(kept.begin(), kept.end(), name) == kept.end()) kept.push_back(name);
  used = std::move(kept);
  if (used.empty()) document.erase("extensionsUsed");  // an empty list is not valid
  const auto required = document.find("extensionsRequired");
  if (required == document.end() || !required->is_array()) return;
  *required = without_draco(*required);
  if (required->empty()) document.erase("extensionsRequired");  // an empty list is not valid
}

}  // namespace

proto::Expected<void> write_lit_glb(int fd, const files::SceneFiles& files,
                                    const scene::Scene& scene, const atlas::Atlas& atlas,
                                    const LitPages& light, const files::ImportLimits& limits) {
  auto document = LitDocument::open(files, limits);
  if (!document) return Unexpected(document.error());
  if (auto ok = LitScene(**document, scene, atlas, light).build(); !ok) return ok;
  if (!light.keep_lights) drop_baked_lights((*document)->json());
  list_extensions((*document)->json(), LitMaterials::extensions(light));
  return (*document)->write(fd);
}

proto::Expected<void> write_lit_glb(const std::filesystem::path& path,
                                    const files::SceneFiles& files, const scene::Scene& scene,
                                    const atlas::Atlas& atlas, const LitPages& pages,
                                    const files::ImportLimits& limits) {
  const proto::Fd file(::open(path.c_str(), O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0666));
  if (!file.valid()) return proto::storage_error("create", path);
  return write_lit_glb(file.get(), files, scene, atlas, pages, limits);
}

}  // namespace kiln::output::lit
