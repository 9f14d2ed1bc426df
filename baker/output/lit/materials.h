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
  LitMaterials(LitDocument&, const LitPages&, std::set<std::uint64_t> unlit_uses);

  /// Returns the extensions that materials and nodes of such light have.
  static std::vector<const char*> extensions(const LitPages&);

  /// Says whether a texture of the material reads TEXCOORD_1 in lit.glb too.
  bool reads_texcoord_1(std::optional<std::uint64_t> material);
  /// Says whether the pages hold the albedo, with the colors of vertices in it.
  bool hold_albedo() const { return mode_ == proto::GlbMode::kUnlit; }

  /// Returns the material (nothing: glTF's default) with the page's light; where `move_to` is not 1
  /// its other textures read TEXCOORD_<move_to> instead of TEXCOORD_1. The first variant takes the
  /// material's own place, so that indices elsewhere stay true. A material that is no unlit one has
  /// the page's number in extras.lightkiln.page, unless the source's extras are no object.
  std::uint32_t variant(std::optional<std::uint64_t> material, std::uint32_t page,
                        std::uint32_t move_to);

  /// Gives a node on that page its MX_lightmap, where the pages are RGBM.
  void mark_node(Json& node, std::uint32_t page) const;

  /// Returns for asset.extras the pages' encoding and formula, and of each page the texture, the
  /// scale, what it clips, the exposure and the name of its EXR.
  Json describe() const;

 private:
  Json light(Json material, std::uint32_t page, std::uint32_t move_to) const;
  Json unlit(Json material, std::uint32_t page) const;
  Json texture_info(std::uint32_t page) const;

  LitDocument& document_;
  proto::GlbLightmap lightmap_;
  proto::GlbMode mode_;
  std::vector<LitPage> pages_;           ///< without their PNG
  std::vector<std::uint32_t> textures_;  ///< of the pages; none for GlbLightmap::kNone
  std::set<std::uint64_t> taken_;        ///< materials whose place is not free
  std::vector<Json> originals_;
  std::map<std::tuple<std::optional<std::uint64_t>, std::uint32_t, std::uint32_t>, std::uint32_t>
      variants_;
};

}  // namespace kiln::output::lit
