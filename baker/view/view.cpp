#include "baker/view/view.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "baker/output/post.h"
#include "baker/trace/ray_scene.h"
#include "baker/view/camera.h"
#include "baker/view/pages.h"
#include "baker/view/render.h"
#include "baker/view/wrong.h"
#include "proto/files.h"
#include "proto/json.h"

namespace kiln::view {
namespace {

using proto::Expected;
using proto::Unexpected;
using Code = std::array<std::uint8_t, 3>;

constexpr std::uint64_t kMaxManifestBytes = std::uint64_t{256} << 20;
constexpr float kMaxExposure = 1e9f;
constexpr Code kBackground{40, 44, 52};

// Bytes that draw() takes.
constexpr std::uint64_t kTriangle = 250;  ///< the tree of the ray scene, and its copy of vertices
constexpr std::uint64_t kTexel = 16;      ///< of a page
constexpr std::uint64_t kDecoded = 32;    ///< of the page that is read: its file, and a copy
constexpr std::uint64_t kPixel = 28;      ///< value and coverage, codes, and their PNG

std::string all_layers() {
  std::string names;
  for (const output::Layer& layer : output::layers())
    names.append(names.empty() ? "`" : ", `").append(layer.name).append("`");
  return names;
}

proto::Unexpected wrong_size() {
  return wrong("bad_request", "size",
               "It has to be WIDTHxHEIGHT in pixels, such as 1024x768, each from 1 to " +
                   std::to_string(kMaxSide) + ".");
}

/// Lets what is behind the scene show through where a pixel shows it in part.
void put_on_background(std::vector<Code>& pixels, const std::vector<float>& coverage) {
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (std::size_t c = 0; c < 3; ++c) {
      const float behind = kBackground[c], over = pixels[i][c];
      pixels[i][c] = static_cast<std::uint8_t>(behind + (over - behind) * coverage[i] + 0.5f);
    }
}

}  // namespace

Expected<Size> parse_size(const std::string& text) {
  Size size;
  const char *at = text.data(), *const end = at + text.size();
  const auto width = std::from_chars(at, end, size.width);
  if (width.ec != std::errc() || width.ptr == end || *width.ptr != 'x') return wrong_size();
  const auto height = std::from_chars(width.ptr + 1, end, size.height);
  if (height.ec != std::errc() || height.ptr != end) return wrong_size();
  return size;
}

Expected<void> check(const Request& request) {
  const output::Layer* layer = output::find_layer(request.layer);
  if (!layer)
    return wrong(
        "bad_request", "layer",
        "There is no layer `" + request.layer + "`. It has to be one of " + all_layers() + ".");
  if (request.shaded && layer->shown != output::Shown::kPageLight)
    return wrong("bad_request", "shaded",
                 "Only irradiance can be shaded: the layers irradiance, direct, indirect and raw.");
  for (const std::uint32_t side : {request.size.width, request.size.height})
    if (side < 1 || side > kMaxSide) return wrong_size();
  if (request.exposure && !(*request.exposure > 0 && *request.exposure <= kMaxExposure))
    return wrong("bad_request", "exposure", "It has to be a number over 0, at most 1e9.");
  return check_camera(request.camera);
}

Expected<proto::Manifest> read_manifest(const std::filesystem::path& folder) {
  const auto path = folder / "manifest.json";
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error))
    return proto::fail("not_found", "There is no " + path.string() +
                                        ": a view needs the folder that a bake has written.");
  const auto text = proto::read_file(path, kMaxManifestBytes);
  if (!text) return Unexpected(text.error());
  const auto document = proto::parse_json(*text, "manifest");
  if (!document) return proto::fail("bad_document", document.error().message);
  return proto::manifest_from_json(*document);
}

std::uint64_t memory_bytes(const scene::Scene& scene, const proto::Manifest& manifest,
                           const Request& request) {
  std::uint64_t texels = 0, largest = 0;
  for (const proto::PageInfo& page : manifest.pages) {
    const std::uint64_t size = std::uint64_t{page.width} * page.height;
    texels += size;
    largest = std::max(largest, size);
  }
  return scene::memory_bytes(scene) + scene.triangles.size() * kTriangle + texels * kTexel +
         largest * kDecoded + std::uint64_t{request.size.width} * request.size.height * kPixel;
}

Expected<Picture> draw(const std::filesystem::path& folder, const proto::Manifest& manifest,
                       const scene::Scene& scene, SceneKind kind, const Request& request,
                       exec::ThreadPool& pool, std::stop_token stop) {
  if (auto ok = check(request); !ok) return Unexpected(ok.error());
  if (request.shaded && kind == SceneKind::kLit &&
      manifest.settings.output.glb_mode == proto::GlbMode::kUnlit)
    return wrong("bad_request", "shaded",
                 "The albedo is not known: the materials of this lit.glb are unlit, with the light "
                 "in their color. Bake with `output.glb_mode` \"lightmap\".");
  const Size size = request.size;
  const auto lens = choose_camera(request.camera, scene, float(size.width) / float(size.height),
                                  request.orthographic);
  if (!lens) return Unexpected(lens.error());
  const auto places = view::places(scene, kind, manifest);
  if (!places) return Unexpected(places.error());
  const auto pages = read_pages(folder, manifest, request.layer, stop);
  if (!pages) return Unexpected(pages.error());
  const auto rays = trace::RayScene::build(scene, stop);
  if (!rays) return Unexpected(rays.error());
  auto seen = render({scene, *rays, *pages, *places, *lens, request}, pool, stop);
  if (!seen) return Unexpected(seen.error());

  Picture picture{size.width, size.height, {}, 1};
  const output::Shown shown = pages->layer->shown;
  output::Tone tone;
  if (output::is_light(shown))
    tone = output::tone_of(*seen, request.exposure, manifest.settings.output.tone_curve);
  picture.exposure = tone.exposure;
  picture.pixels = output::show(*seen, shown, tone, pages->range);
  put_on_background(picture.pixels, seen->coverage);
  return picture;
}

}  // namespace kiln::view
