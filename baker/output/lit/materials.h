#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "baker/output/lit/document.h"
#include "baker/output/output.h"

namespace kiln::output::lit {

/// The pages' lightmaps in the document, and the variants of its materials that show them.
class LitMaterials {
 public:
  /// Adds images, textures and one sampler (linear, clamped, no mipmaps: those would mix charts).
  /// `unlit_uses`: materials that something without a lightmap uses too, and so stay as they are.
  LitMaterials(LitDocument&, std::span<const LitPage>, std::set<std::uint64_t> unlit_uses);

  /// Says whether a texture of the material reads TEXCOORD_1.
  bool reads_texcoord_1(std::optional<std::uint64_t> material);

  /// Returns the material (nothing: glTF's default) with the page's lightmap by MOZ_lightmap; where
  /// `move_to` is not 1 its other textures read TEXCOORD_<move_to> instead of TEXCOORD_1. The first
  /// variant takes the material's own place, so that indices elsewhere stay true.
  std::uint32_t variant(std::optional<std::uint64_t> material, std::uint32_t page,
                        std::uint32_t move_to);

  /// Returns the MX_lightmap of a node on that page.
  Json node_extension(std::uint32_t page) const;

  /// Returns for asset.extras of each page the texture, the scale, the exposure and the name of its
  /// EXR.
  Json describe_pages() const;

 private:
  LitDocument& document_;
  std::vector<LitPage> pages_;  ///< without their PNG
  std::vector<std::uint32_t> textures_;
  std::set<std::uint64_t> taken_;  ///< materials whose place is not free
  std::vector<Json> originals_;
  std::map<std::tuple<std::optional<std::uint64_t>, std::uint32_t, std::uint32_t>, std::uint32_t>
      variants_;
};

}  // namespace kiln::output::lit
