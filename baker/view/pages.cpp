#include "baker/view/pages.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "baker/exec/stop.h"
#include "baker/view/wrong.h"

namespace kiln::view {
namespace {

using math::Rgb;
using math::Vec2;

proto::Unexpected damaged(const std::string& why) {
  return proto::fail("bad_document", "The manifest does not fit its results: " + why);
}

/// Returns whether a file's name leads nowhere but into its folder.
bool is_plain(const std::string& name) {
  return !name.empty() && name.front() != '.' && name.find('/') == name.npos &&
         name.find('\0') == name.npos;
}

proto::Unexpected no_layer(const std::string& layer, const std::vector<std::string>& there) {
  std::string names;
  for (const std::string& name : there) names += (names.empty() ? "`" : ", `") + name + "`";
  return wrong("not_found", "layer",
               "The pages have no layer `" + layer + "`, only " + names +
                   ". Bake with it among `output.layers`, and `exr` among `output.formats`.");
}

/// Returns the place of a value among `size` texels.
std::size_t texel_at(float at, std::uint32_t size) {
  return std::size_t(std::clamp(std::floor(at), 0.f, float(size - 1)));
}

}  // namespace

proto::Expected<Pages> read_pages(const std::filesystem::path& folder,
                                  const proto::Manifest& manifest, const std::string& layer,
                                  const std::stop_token& stop) {
  Pages pages;
  pages.layer = output::find_layer(layer);
  const auto& there = manifest.settings.output.layers;
  const auto found = std::ranges::find(there, layer);
  if (!pages.layer || found == there.end()) return no_layer(layer, there);
  // The first layer is the one without a name.
  const std::string channels = found == there.begin() ? "" : layer;
  for (const proto::PageInfo& info : manifest.pages) {
    if (info.exr.empty()) return no_layer(layer, {});
    if (!is_plain(info.exr)) return damaged("the name of a page");
    auto image = image::read_exr(folder / info.exr, channels, stop);
    if (!image) return proto::Unexpected(image.error());
    if (image->width != info.width || image->height != info.height || image->rgb.empty())
      return damaged("the size of " + info.exr);
    exec::StopPoll stopped(stop);
    for (std::size_t i = 0; i < image->rgb.size(); ++i) {
      if (stopped()) return exec::canceled();
      if (image->coverage[i] > 0) pages.range.add(image->rgb[i]);
    }
    pages.images.push_back(std::move(*image));
  }
  return pages;
}

Rgb nearest(const image::PageImage& page, Vec2 uv) {
  const std::size_t x = texel_at(uv.x * float(page.width), page.width);
  const std::size_t y = texel_at(uv.y * float(page.height), page.height);
  return page.rgb[y * page.width + x];
}

Rgb bilinear(const image::PageImage& page, Vec2 uv) {
  constexpr float kLeast = 1e-3f;
  const float x = uv.x * float(page.width) - 0.5f, y = uv.y * float(page.height) - 0.5f;
  const float fx = x - std::floor(x), fy = y - std::floor(y);
  Rgb sum;
  float weights = 0;
  for (const int dy : {0, 1})
    for (const int dx : {0, 1}) {
      const std::size_t at =
          texel_at(y + float(dy), page.height) * page.width + texel_at(x + float(dx), page.width);
      const float weight = (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy);
      if (!(page.coverage[at] > 0)) continue;
      sum += page.rgb[at] * weight;
      weights += weight;
    }
  return weights > kLeast ? sum * (1 / weights) : nearest(page, uv);
}

proto::Expected<std::vector<MeshPlace>> places(const scene::Scene& scene, SceneKind kind,
                                               const proto::Manifest& manifest) {
  std::map<std::uint32_t, const proto::NodePlacement*> of_node;
  for (const proto::NodePlacement& node : manifest.nodes) of_node[node.node] = &node;
  std::vector<MeshPlace> out;
  for (const scene::Instance& instance : scene.instances) {
    const std::string at = "/nodes/" + std::to_string(instance.node);
    const auto invalid = [&](const std::string& why) {
      return proto::fail("invalid_scene", why, "scene", at);
    };
    const auto found = of_node.find(instance.node);
    if (found == of_node.end())
      return invalid("The scene is not the one of this bake: the manifest lists no such node.");
    const proto::NodePlacement& node = *found->second;
    if (node.page >= manifest.pages.size()) return damaged("the page of a node");
    for (std::uint32_t p = 0; p < instance.part_count; ++p)
      if (!scene.parts[instance.first_part + p].has_lightmap_uv)
        return invalid(
            "Its mesh has no TEXCOORD_1, so its place on the page is not known. The "
            "bake's own lit.glb has it.");
    MeshPlace place{node.page};
    if (kind == SceneKind::kSource) {
      if (node.uv_source != "texcoord_1")
        return invalid(
            "The bake unwrapped its mesh: only the bake's own lit.glb knows its place "
            "on the page.");
      place.scale = {node.scale[0], node.scale[1]};
      place.offset = {node.offset[0], node.offset[1]};
    }
    out.push_back(place);
  }
  return out;
}

}  // namespace kiln::view
