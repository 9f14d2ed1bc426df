#include "baker/output/lit/materials.h"

#include <nlohmann/json.hpp>

#include "baker/output/lit_page.h"

namespace kiln::output::lit {
namespace {

constexpr int kLinear = 9729, kClamp = 33071;
/// The roughness that KHR_materials_unlit advises for viewers that do not know it.
constexpr double kUnlitRoughness = 0.9;

/// Every textureInfo of a material, those of extensions too, that reads TEXCOORD_1.
template <class Visit>
void for_texcoord_1(Json& value, Visit visit) {
  if (value.is_array())
    for (Json& item : value) for_texcoord_1(item, visit);
  if (!value.is_object()) return;
  for (auto& [key, member] : value.items()) {
    if (key == "extras") continue;
    if (key == "texCoord" && as_count(member) == 1)
      visit(member);
    else
      for_texcoord_1(member, visit);
  }
}

/// Returns the factor on the alpha of a material's color.
double alpha_factor(const Json& material) {
  for (const char* place : {"/pbrMetallicRoughness/baseColorFactor",
                            "/extensions/KHR_materials_pbrSpecularGlossiness/diffuseFactor"}) {
    const Json::json_pointer factor(place);
    if (!material.contains(factor)) continue;
    const Json& rgba = material[factor];
    if (rgba.is_array() && rgba.size() == 4 && rgba[3].is_number()) return rgba[3].get<double>();
  }
  return 1;
}

const char* encoding_of(proto::GlbLightmap lightmap, proto::GlbMode mode) {
  if (mode == proto::GlbMode::kUnlit) return "display";
  switch (lightmap) {
    case proto::GlbLightmap::kSrgb8:
      return "srgb8";
    case proto::GlbLightmap::kRgbm:
      return "rgbm";
    case proto::GlbLightmap::kNone:
      break;
  }
  return "none";
}

const char* formula_of(proto::GlbLightmap lightmap, proto::GlbMode mode) {
  if (mode == proto::GlbMode::kUnlit)
    return "rgb = sRGB code of x (1 + x / 16) / (1 + x), x = exposure * (albedo * E + pi * L)";
  switch (lightmap) {
    case proto::GlbLightmap::kSrgb8:
      return "E = scale * linear(rgb), with the transfer function of sRGB";
    case proto::GlbLightmap::kRgbm:
      return "E = scale * alpha^2.2 * rgb, with rgb and alpha = code / 255";
    case proto::GlbLightmap::kNone:
      break;
  }
  return "";
}

}  // namespace

LitMaterials::LitMaterials(LitDocument& document, const LitPages& light,
                           std::set<std::uint64_t> unlit_uses)
    : document_(document),
      lightmap_(light.lightmap),
      mode_(light.mode),
      taken_(std::move(unlit_uses)) {
  if (const auto found = document.json().find("materials"); found != document.json().end())
    for (const Json& material : *found) originals_.push_back(material);
  for (const LitPage& page : light.pages) {
    pages_.push_back({"", page.scale, page.exr, page.exposure, page.clipped, page.clipped_lamps});
  }
  if (lightmap_ == proto::GlbLightmap::kNone) return;
  const std::uint32_t sampler = document.add(
      "samplers",
      {{"magFilter", kLinear}, {"minFilter", kLinear}, {"wrapS", kClamp}, {"wrapT", kClamp}});
  for (std::size_t i = 0; i < light.pages.size(); ++i) {
    const std::string name = "lightmap_" + std::to_string(i);
    const std::uint32_t image =
        document.add("images", {{"name", name},
                                {"mimeType", "image/png"},
                                {"bufferView", document.add_view(light.pages[i].png)}});
    textures_.push_back(
        document.add("textures", {{"name", name}, {"sampler", sampler}, {"source", image}}));
  }
}

std::vector<const char*> LitMaterials::extensions(const LitPages& light) {
  if (light.mode == proto::GlbMode::kUnlit) return {"KHR_materials_unlit"};
  if (light.lightmap == proto::GlbLightmap::kSrgb8) return {"MOZ_lightmap"};
  if (light.lightmap == proto::GlbLightmap::kRgbm) return {"MX_lightmap"};
  return {};
}

bool LitMaterials::reads_texcoord_1(std::optional<std::uint64_t> material) {
  bool found = false;
  if (material && *material < originals_.size() && !hold_albedo())
    for_texcoord_1(originals_[*material], [&](Json&) { found = true; });
  return found;
}

Json LitMaterials::texture_info(std::uint32_t page) const {
  return {{"index", textures_.at(page)}, {"texCoord", 1}};
}

/// Returns the material with the page as its lightmap.
Json LitMaterials::light(Json material, std::uint32_t page, std::uint32_t move_to) const {
  if (move_to != 1) for_texcoord_1(material, [&](Json& texcoord) { texcoord = move_to; });
  if (lightmap_ == proto::GlbLightmap::kSrgb8) {
    Json lightmap = texture_info(page);
    lightmap["intensity"] = pages_.at(page).scale;
    extensions_of(material)["MOZ_lightmap"] = std::move(lightmap);
  }
  if (!material.contains("extras") || material["extras"].is_object())
    material["extras"]["lightkiln"] = {{"page", page}};
  return material;
}

/// Returns an unlit material that shows the page. What the light does at the surface is in the
/// page, so all that describes it goes.
Json LitMaterials::unlit(Json material, std::uint32_t page) const {
  Json made = {{"pbrMetallicRoughness",
                {{"baseColorTexture", texture_info(page)},
                 {"metallicFactor", 0},
                 {"roughnessFactor", kUnlitRoughness}}}};
  const Json mode = material.value("alphaMode", Json("OPAQUE"));
  if (mode != "OPAQUE")
    made["pbrMetallicRoughness"]["baseColorFactor"] = {1, 1, 1, alpha_factor(material)};
  for (const char* kept : {"name", "extras", "alphaMode", "alphaCutoff", "doubleSided"})
    if (material.contains(kept)) made[kept] = std::move(material[kept]);
  Json& extensions = extensions_of(made);
  if (material.contains("extensions") && material["extensions"].is_object())
    for (auto& [name, extension] : material["extensions"].items())
      if (!name.starts_with("KHR_materials_")) extensions[name] = std::move(extension);
  extensions["KHR_materials_unlit"] = Json::object();
  return made;
}

std::uint32_t LitMaterials::variant(std::optional<std::uint64_t> material, std::uint32_t page,
                                    std::uint32_t move_to) {
  if (material && *material >= originals_.size()) material.reset();
  const auto [found, is_new] = variants_.emplace(std::tuple{material, page, move_to}, 0u);
  if (!is_new) return found->second;

  Json source = material ? originals_[*material] : Json::object();
  Json made =
      hold_albedo() ? unlit(std::move(source), page) : light(std::move(source), page, move_to);
  if (material && taken_.insert(*material).second) {
    document_.json()["materials"][*material] = std::move(made);
    found->second = static_cast<std::uint32_t>(*material);
  } else {
    found->second = document_.add("materials", std::move(made));
  }
  return found->second;
}

void LitMaterials::mark_node(Json& node, std::uint32_t page) const {
  if (hold_albedo() || lightmap_ != proto::GlbLightmap::kRgbm) return;
  extensions_of(node)["MX_lightmap"] = {
      {"lightMapTexture", texture_info(page)},
      {"intensity", double(pages_.at(page).scale) / double(kRgbmRange)}};
}

Json LitMaterials::describe() const {
  const bool scaled = !hold_albedo() && !textures_.empty();
  Json list = Json::array();
  for (std::size_t i = 0; i < pages_.size(); ++i) {
    Json page = Json::object();
    if (!textures_.empty()) page["texture"] = textures_[i];
    if (scaled) page["scale"] = pages_[i].scale;
    if (scaled && lightmap_ == proto::GlbLightmap::kSrgb8) {
      page["clipped"] = pages_[i].clipped;
      page["clipped_lamps"] = pages_[i].clipped_lamps;
    }
    page["exposure"] = pages_[i].exposure;
    if (!pages_[i].exr.empty()) page["exr"] = pages_[i].exr;
    list.push_back(std::move(page));
  }
  Json described = {{"encoding", encoding_of(lightmap_, mode_)}};
  if (const std::string formula = formula_of(lightmap_, mode_); !formula.empty())
    described["formula"] = formula;
  described["pages"] = std::move(list);
  return described;
}

}  // namespace kiln::output::lit
