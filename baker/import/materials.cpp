#include "baker/import/materials.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::import {
namespace {

/// Returns a member of an object; an empty value when there is none.
const tinygltf::Value& member(const tinygltf::Value& object, const char* key) {
  static const tinygltf::Value none;
  return object.IsObject() && object.Has(key) ? object.Get(key) : none;
}
float number_or(const tinygltf::Value& value, double fallback) {
  return static_cast<float>(value.IsNumber() ? value.GetNumberAsDouble() : fallback);
}
/// Returns element i of an array of numbers.
float element_or(const tinygltf::Value& array, int i, double fallback) {
  return array.IsArray() ? number_or(array.Get(i), fallback) : static_cast<float>(fallback);
}

scene::Wrap wrap_of(int mode) {
  if (mode == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return scene::Wrap::kClamp;
  return mode == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT ? scene::Wrap::kMirror
                                                       : scene::Wrap::kRepeat;
}

/// Returns the image of a texture, -1 when it has none that can be read.
std::int32_t image_of(gltf::Document& document, const tinygltf::Texture& texture,
                      const std::string& at) {
  // `source` is for readers that can't read the other image.
  if (const auto webp = texture.extensions.find("EXT_texture_webp");
      webp != texture.extensions.end()) {
    const tinygltf::Value& source = member(webp->second, "source");
    if (source.IsNumber()) return source.GetNumberAsInt();
  }
  if (texture.source >= 0) return texture.source;
  const bool basisu = texture.extensions.contains("KHR_texture_basisu");
  document.warnings.add("texture_ignored", at,
                        std::string("the texture has no image") +
                            (basisu ? " but that of KHR_texture_basisu" : "") +
                            ": the factor alone is used");
  return -1;
}

scene::Texture read_texture(gltf::Document& document, int index) {
  scene::Texture out;
  if (index < 0) return out;
  const auto& model = *document.model;
  const auto& texture = model.textures[static_cast<std::size_t>(index)];
  out.image =
      image_of(document, texture, gltf::pointer_to("/textures", static_cast<std::size_t>(index)));
  if (texture.sampler < 0) return out;
  const auto& sampler = model.samplers[static_cast<std::size_t>(texture.sampler)];
  out.wrap_u = wrap_of(sampler.wrapS);
  out.wrap_v = wrap_of(sampler.wrapT);
  out.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
  return out;
}

UvSource read_uv(int set, const tinygltf::Value& transform) {
  UvSource out;
  out.set = static_cast<std::uint32_t>(std::max(set, 0));
  out.offset = {element_or(member(transform, "offset"), 0, 0),
                element_or(member(transform, "offset"), 1, 0)};
  out.scale = {element_or(member(transform, "scale"), 0, 1),
               element_or(member(transform, "scale"), 1, 1)};
  out.rotation = number_or(member(transform, "rotation"), 0);
  const auto& override_set = member(transform, "texCoord");
  if (override_set.IsInt())
    out.set = static_cast<std::uint32_t>(std::max(override_set.GetNumberAsInt(), 0));
  return out;
}

UvSource read_uv(const tinygltf::TextureInfo& info) {
  const auto transform = info.extensions.find("KHR_texture_transform");
  return read_uv(info.texCoord,
                 transform == info.extensions.end() ? tinygltf::Value() : transform->second);
}

/// Reads the base color of KHR_materials_pbrSpecularGlossiness, which replaces the core's.
void read_specular_glossiness(gltf::Document& document, const tinygltf::Value& extension,
                              MaterialSource& out) {
  const auto& factor = member(extension, "diffuseFactor");
  out.material.base_color = {element_or(factor, 0, 1), element_or(factor, 1, 1),
                             element_or(factor, 2, 1)};
  const auto& info = member(extension, "diffuseTexture");
  out.material.base_texture = {};
  out.base_uv = {};
  if (!info.IsObject()) return;
  out.material.base_texture = read_texture(document, member(info, "index").GetNumberAsInt());
  out.base_uv = read_uv(static_cast<int>(number_or(member(info, "texCoord"), 0)),
                        member(member(info, "extensions"), "KHR_texture_transform"));
}

void read_alpha(gltf::Document& document, const tinygltf::Material& source, MaterialSource& out) {
  if (source.alphaMode == "MASK" || source.alphaMode == "BLEND") {
    out.material.alpha_mode =
        source.alphaMode == "MASK" ? scene::AlphaMode::kMask : scene::AlphaMode::kBlend;
    document.warnings.add("alpha_ignored", out.pointer + "/alphaMode",
                          "alphaMode " + source.alphaMode + " is baked as opaque");
  } else if (source.alphaMode != "OPAQUE") {
    document.warnings.add("alpha_ignored", out.pointer + "/alphaMode",
                          "alphaMode is unknown: the material is baked as opaque");
  }
  out.material.alpha_cutoff = static_cast<float>(source.alphaCutoff);
}

/// Clamps the base color to 0..1: a factor of an albedo reflects no more than all light.
void clamp_base_color(gltf::Document& document, MaterialSource& out) {
  const math::Rgb c = out.material.base_color;
  out.material.base_color = {std::clamp(c.r, 0.f, 1.f), std::clamp(c.g, 0.f, 1.f),
                             std::clamp(c.b, 0.f, 1.f)};
  if (out.material.base_color == c) return;
  document.warnings.add("base_color_clamped", out.pointer,
                        "the base color factor is outside 0 to 1 and is clamped");
}

}  // namespace

math::Vec2 UvSource::apply(math::Vec2 uv) const {
  const float x = uv.x * scale.x, y = uv.y * scale.y;
  if (rotation == 0) return {x + offset.x, y + offset.y};
  const float c = std::cos(rotation), s = std::sin(rotation);
  return {c * x + s * y + offset.x, c * y - s * x + offset.y};
}

MaterialSource read_material(gltf::Document& document, std::int32_t index) {
  MaterialSource out;
  out.material.source = index;
  if (index < 0) return out;
  out.pointer = gltf::pointer_to("/materials", static_cast<std::size_t>(index));
  const auto& source = document.model->materials[static_cast<std::size_t>(index)];
  const auto& pbr = source.pbrMetallicRoughness;
  out.material.base_color = {static_cast<float>(pbr.baseColorFactor[0]),
                             static_cast<float>(pbr.baseColorFactor[1]),
                             static_cast<float>(pbr.baseColorFactor[2])};
  out.material.base_texture = read_texture(document, pbr.baseColorTexture.index);
  out.base_uv = read_uv(pbr.baseColorTexture);
  const auto extension = [&](const char* name) -> const tinygltf::Value* {
    const auto found = source.extensions.find(name);
    return found == source.extensions.end() ? nullptr : &found->second;
  };
  if (const auto* gloss = extension("KHR_materials_pbrSpecularGlossiness")) {
    read_specular_glossiness(document, *gloss, out);
  }
  clamp_base_color(document, out);
  const auto* strength = extension("KHR_materials_emissive_strength");
  const double scale = strength ? number_or(member(*strength, "emissiveStrength"), 1) : 1;
  const auto emitted = [&](std::size_t c) {
    constexpr double kMaxRadiance = 1e30;  // cd/m2: sums over a scene still fit a float
    return static_cast<float>(std::min(source.emissiveFactor[c] * scale, kMaxRadiance));
  };
  out.material.emission = {emitted(0), emitted(1), emitted(2)};
  out.material.emission_texture = read_texture(document, source.emissiveTexture.index);
  out.emission_uv = read_uv(source.emissiveTexture);
  out.material.double_sided = source.doubleSided;
  read_alpha(document, source, out);
  return out;
}

}  // namespace kiln::import
