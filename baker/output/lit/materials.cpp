#include "baker/output/lit/materials.h"

#include <nlohmann/json.hpp>

namespace kiln::output::lit {
namespace {

constexpr int kLinear = 9729, kClamp = 33071;
/// MX_lightmap decodes RGBM: E = 34.49 * alpha^2.2 * rgb * intensity. An opaque page has alpha 1.
constexpr double kRgbmRange = 34.49;

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

}  // namespace

LitMaterials::LitMaterials(LitDocument& document, std::span<const LitPage> pages,
                           std::set<std::uint64_t> unlit_uses)
    : document_(document), taken_(std::move(unlit_uses)) {
  if (const auto found = document.json().find("materials"); found != document.json().end())
    for (const Json& material : *found) originals_.push_back(material);
  const std::uint32_t sampler = document.add(
      "samplers",
      {{"magFilter", kLinear}, {"minFilter", kLinear}, {"wrapS", kClamp}, {"wrapT", kClamp}});
  for (std::size_t i = 0; i < pages.size(); ++i) {
    const std::string name = "lightmap_" + std::to_string(i);
    const std::uint32_t image =
        document.add("images", {{"name", name},
                                {"mimeType", "image/png"},
                                {"bufferView", document.add_view(pages[i].png)}});
    textures_.push_back(
        document.add("textures", {{"name", name}, {"sampler", sampler}, {"source", image}}));
    pages_.push_back({"", pages[i].scale, pages[i].exr, pages[i].exposure});
  }
}

bool LitMaterials::reads_texcoord_1(std::optional<std::uint64_t> material) {
  bool found = false;
  if (material && *material < originals_.size())
    for_texcoord_1(originals_[*material], [&](Json&) { found = true; });
  return found;
}

std::uint32_t LitMaterials::variant(std::optional<std::uint64_t> material, std::uint32_t page,
                                    std::uint32_t move_to) {
  if (material && *material >= originals_.size()) material.reset();
  const auto [found, is_new] = variants_.emplace(std::tuple{material, page, move_to}, 0u);
  if (!is_new) return found->second;

  Json made = material ? originals_[*material] : Json::object();
  if (move_to != 1) for_texcoord_1(made, [&](Json& texcoord) { texcoord = move_to; });
  extensions_of(made)["MOZ_lightmap"] = {
      {"index", textures_.at(page)}, {"texCoord", 1}, {"intensity", pages_.at(page).scale}};
  if (material && taken_.insert(*material).second) {
    document_.json()["materials"][*material] = std::move(made);
    found->second = static_cast<std::uint32_t>(*material);
  } else {
    found->second = document_.add("materials", std::move(made));
  }
  return found->second;
}

Json LitMaterials::node_extension(std::uint32_t page) const {
  return {{"lightMapTexture", {{"index", textures_.at(page)}, {"texCoord", 1}}},
          {"intensity", double(pages_.at(page).scale) / kRgbmRange}};
}

Json LitMaterials::describe_pages() const {
  Json list = Json::array();
  for (std::size_t i = 0; i < pages_.size(); ++i) {
    Json page = {
        {"texture", textures_[i]}, {"scale", pages_[i].scale}, {"exposure", pages_[i].exposure}};
    if (!pages_[i].exr.empty()) page["exr"] = pages_[i].exr;
    list.push_back(std::move(page));
  }
  return list;
}

}  // namespace kiln::output::lit
