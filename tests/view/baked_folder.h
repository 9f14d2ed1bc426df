#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "baker/image/page_image.h"
#include "baker/view/view.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_files.h"

namespace kiln::view {

using Code = std::array<std::uint8_t, 3>;

/// The results of a bake, made by hand: pages of one layer, and a manifest.
struct BakedFolder {
  test::TempFolder folder;
  proto::Manifest manifest;

  BakedFolder(const std::string& layer, const std::vector<image::PageImage>& pages) {
    manifest.settings.output.layers = {"irradiance", layer};
    if (layer == "irradiance") manifest.settings.output.layers.pop_back();
    for (std::size_t p = 0; p < pages.size(); ++p) {
      proto::PageInfo info{pages[p].width, pages[p].height, 0, {}, {}, 0, 0};
      info.exr = "page_0" + std::to_string(p) + ".exr";
      image::PageImage black = pages[p];
      for (math::Rgb& v : black.rgb) v = {};
      std::vector<image::ExrLayer> layers{{"irradiance", &black}, {layer, &pages[p]}};
      if (layer == "irradiance") layers.erase(layers.begin());
      EXPECT_TRUE(image::write_exr(folder.path() / info.exr, layers, proto::Precision::kFloat, {}));
      manifest.pages.push_back(info);
    }
  }
  /// Places node after node, each on the page given.
  BakedFolder& nodes(const std::vector<std::uint32_t>& pages) {
    for (const std::uint32_t page : pages) {
      proto::NodePlacement node;
      node.node = node.mesh = std::uint32_t(manifest.nodes.size());
      node.page = page;
      node.uv_source = "texcoord_1";
      manifest.nodes.push_back(node);
    }
    return *this;
  }
  proto::Expected<Picture> draw(const scene::Scene& scene, const Request& request,
                                SceneKind kind = SceneKind::kLit, unsigned threads = 2,
                                std::stop_token stop = {}) const {
    exec::ThreadPool pool(threads);
    return view::draw(folder.path(), manifest, scene, kind, request, pool, std::move(stop));
  }
};

/// A page whose texels have the colors of a function of x and y; all are lit.
template <class Color>
image::PageImage page_of(std::uint32_t size, Color color) {
  image::PageImage page{size, size, {}, {}};
  for (std::uint32_t y = 0; y < size; ++y)
    for (std::uint32_t x = 0; x < size; ++x) page.rgb.push_back(color(x, y));
  page.coverage.assign(page.rgb.size(), 1);
  return page;
}
inline image::PageImage plain_page(math::Rgb color) {
  return page_of(4, [&](auto, auto) { return color; });
}

inline Code pixel(const Picture& picture, std::uint32_t x, std::uint32_t y) {
  return picture.pixels.at(std::size_t(y) * picture.width + x);
}

/// A unit square in the plane z = 0 that faces +Z.
inline test::Mesh unit_square() {
  return test::quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
}

/// An orthographic view of it, of one pixel per texel of a page of 4 x 4.
inline Request square_request(const std::string& layer) {
  Request request;
  request.layer = layer;
  request.camera = "0.5,0.5,2:0.5,0.5,0:1";
  request.orthographic = true;
  request.size = {4, 4};
  request.nearest = true;
  return request;
}

}  // namespace kiln::view
