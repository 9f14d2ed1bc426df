#pragma once

#include <filesystem>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/image/page_image.h"
#include "baker/math/vec.h"
#include "baker/output/layers.h"
#include "baker/scene/scene.h"
#include "baker/view/view.h"

namespace kiln::view {

/// A layer of all pages of a bake.
struct Pages {
  const output::Layer* layer = nullptr;
  std::vector<image::PageImage> images;
  output::ValueRange range;  ///< of lit texels
};
/// Reads a layer. Errors: `not_found`, `bad_document`, `invalid_image`, `canceled`.
proto::Expected<Pages> read_pages(const std::filesystem::path& folder, const proto::Manifest&,
                                  const std::string& layer, const std::stop_token&);

/// Returns the value at a point of a page, (0, 0) to (1, 1). Bilinear look-ups weigh lit texels
/// only, so that no dark fringe comes from the texels beside a chart; where none is lit, the
/// padding counts.
math::Rgb nearest(const image::PageImage&, math::Vec2 uv);
math::Rgb bilinear(const image::PageImage&, math::Vec2 uv);

/// The place of a mesh on the pages: uv = TEXCOORD_1 * scale + offset.
struct MeshPlace {
  std::uint32_t page = 0;
  math::Vec2 scale{1, 1}, offset{0, 0};
};
/// Returns the place of each instance of the scene. Errors: `invalid_scene`, `bad_document`.
proto::Expected<std::vector<MeshPlace>> places(const scene::Scene&, SceneKind,
                                               const proto::Manifest&);

}  // namespace kiln::view
