#pragma once

#include <cstdint>
#include <vector>

#include "baker/gltf/document.h"
#include "baker/scene/scene.h"

namespace kiln::import {

/// The texture coordinates that a texture is read with [KHR_texture_transform].
struct UvSource {
  std::uint32_t set = 0;  ///< TEXCOORD_n
  math::Vec2 offset, scale{1, 1};
  float rotation = 0;  ///< rad, counter-clockwise in the image

  math::Vec2 apply(math::Vec2 uv) const;
};

/// A glTF material as Scene wants it. Textures name glTF images until the images are loaded.
/// Albedo is baseColorFactor * texture * COLOR_0 whatever metallicFactor says: metals would be
/// black in a purely diffuse bake, and the rooms they stand in too dark.
struct MaterialSource {
  scene::Material material;
  UvSource base_uv, emission_uv;
  std::string pointer;
};

/// Reads the document's material `index`, -1 for the default one. Adds warnings for what is left
/// out.
MaterialSource read_material(gltf::Document&, std::int32_t index);

}  // namespace kiln::import
