#include "baker/gltf/extensions.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>

#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::gltf {
namespace {

/// An extension that the import knows, and its treatment.
struct Known {
  std::string_view name;
  bool may_be_required;  ///< a bake is right, or right but for a warning, where it is required
  std::string_view
      instead;  ///< the warning: what is done instead; "" when it is honored or harmless
};

constexpr std::string_view kDiffuseOnly = "surfaces are baked as diffuse";

constexpr Known kKnown[] = {
    {"KHR_lights_punctual", true, ""},
    {"KHR_materials_emissive_strength", true, ""},
    {"KHR_mesh_quantization", true, ""},
    {"KHR_texture_transform", true, ""},
    {"KHR_materials_pbrSpecularGlossiness", true, ""},
    {"KHR_materials_unlit", true, "unlit surfaces receive and reflect light like others"},
    {"KHR_materials_anisotropy", true, kDiffuseOnly},
    {"KHR_materials_clearcoat", true, kDiffuseOnly},
    {"KHR_materials_iridescence", true, kDiffuseOnly},
    {"KHR_materials_sheen", true, kDiffuseOnly},
    {"KHR_materials_specular", true, kDiffuseOnly},
    {"KHR_materials_ior", true, ""},
    {"KHR_materials_dispersion", true, ""},
    {"KHR_materials_transmission", true, "transmitting surfaces are baked as opaque"},
    {"KHR_materials_diffuse_transmission", true, "transmitting surfaces are baked as opaque"},
    {"KHR_materials_volume", true, "volumes are baked as opaque surfaces"},
    {"KHR_materials_variants", true, "the default variant is baked"},
    {"KHR_animation_pointer", true, "the scene is baked at rest"},
    {"KHR_xmp_json_ld", true, ""},
    {"FB_ngon_encoding", true, ""},
    {"MX_lightmap", true, "a lightmap that the scene already has is not read"},
    {"MOZ_lightmap", true, "a lightmap that the scene already has is not read"},
    {"EXT_lights_image_based", true, "the environment is not read; the sky is set by sky.radiance"},
    {"EXT_mesh_gpu_instancing", false, "each instanced mesh is baked once, at its node"},
    {"KHR_draco_mesh_compression", true, ""},
    {"EXT_meshopt_compression", true, ""},
    {"EXT_texture_webp", true, ""},
    {"KHR_texture_basisu", false, "textures that have no other image are left out"},
};

const Known* find_known(std::string_view name) {
  const auto* found = std::find_if(std::begin(kKnown), std::end(kKnown),
                                   [&](const Known& k) { return k.name == name; });
  return found == std::end(kKnown) ? nullptr : found;
}

}  // namespace

proto::Expected<void> check_required_extensions(const Json& document) {
  const auto required = document.find("extensionsRequired");
  if (required == document.end() || !required->is_array()) return {};  // the schema check's affair
  for (std::size_t i = 0; i < required->size(); ++i) {
    if (!(*required)[i].is_string()) continue;
    const auto name = (*required)[i].get<std::string>();
    const Known* known = find_known(name);
    if (known && known->may_be_required) continue;
    return proto::fail(
        "unsupported_extension",
        "the scene requires the extension " + shortened(name) + ", which is not supported", "scene",
        pointer_to("/extensionsRequired", i));
  }
  return {};
}

void warn_of_extensions(Document& document) {
  const auto& used = document.model->extensionsUsed;
  for (std::size_t i = 0; i < used.size(); ++i) {
    const Known* known = find_known(used[i]);
    if (known && known->instead.empty()) continue;
    document.warnings.add(
        "extension_ignored", pointer_to("/extensionsUsed", i),
        shortened(used[i]) + " is not honored" + (known ? ": " + std::string(known->instead) : ""));
  }
}

}  // namespace kiln::gltf
