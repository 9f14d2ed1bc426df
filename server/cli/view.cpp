#include "baker/view/view.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <thread>

#include "baker/image/page_image.h"
#include "proto/files.h"
#include "server/cli/commands.h"
#include "server/cli/interrupt.h"
#include "server/cli/report.h"
#include "server/cli/side_files.h"
#include "server/sandbox/image_process.h"
#include "server/sandbox/importer.h"

namespace kiln::cli {
namespace {

struct ViewFlags {
  std::string folder, scene, picture, size = "1024x768";
  view::Request request;
  unsigned threads = 0;
  bool bilinear = false;
};

/// A scene, and the kind of file that it was read from.
struct ViewedScene {
  scene::Scene scene;
  view::SceneKind kind = view::SceneKind::kLit;
};

/// Reads the scene: `--scene`, or the results' own lit.glb.
proto::Expected<ViewedScene> read_viewed(const ViewFlags& flags, const proto::Manifest& manifest,
                                         const std::shared_ptr<sandbox::Zygote>& zygote,
                                         const std::stop_token& stop) {
  namespace fs = std::filesystem;
  const fs::path path =
      flags.scene.empty() ? fs::path(flags.folder) / "lit.glb" : fs::path(flags.scene);
  std::error_code error;
  if (!fs::is_regular_file(path, error))
    return proto::fail("not_found",
                       "There is no " + path.string() +
                           ". Bake with `glb` among `output.formats`, or name the scene that was "
                           "baked with --scene.");
  const auto digest = proto::digest_file(path);
  if (!digest) return proto::Unexpected(digest.error());
  auto side = all_side_files(path, {});
  if (!side) return proto::Unexpected(side.error());
  sandbox::Importer::Options importing;
  importing.process.zygote = zygote;
  importing.decodes_images = side->images;
  const auto reader =
      sandbox::Importer(importing).open({path, std::move(side->files), {}}, digest->sha256, {});
  auto scene = reader->import(stop);
  if (!scene) return proto::Unexpected(scene.error());
  const bool is_source = digest->sha256 == manifest.scene_sha256;
  return ViewedScene{std::move(*scene),
                     is_source ? view::SceneKind::kSource : view::SceneKind::kLit};
}

proto::Expected<view::Picture> draw_view(const ViewFlags& flags, const std::stop_token& stop) {
  if (auto ok = view::check(flags.request); !ok) return proto::Unexpected(ok.error());
  const auto manifest = view::read_manifest(flags.folder);
  if (!manifest) return proto::Unexpected(manifest.error());
  const auto zygote = std::make_shared<sandbox::Zygote>(sandbox::Zygote::Options{});
  const sandbox::ImageProcesses images({.zygote = zygote});
  const auto viewed = read_viewed(flags, *manifest, zygote, stop);
  if (!viewed) return proto::Unexpected(viewed.error());
  exec::ThreadPool pool(flags.threads != 0 ? flags.threads
                                           : std::max(1u, std::thread::hardware_concurrency()));
  auto picture =
      view::draw(flags.folder, *manifest, viewed->scene, viewed->kind, flags.request, pool, stop);
  if (!picture) return picture;
  const auto png = image::encode_png(picture->pixels, picture->width, picture->height);
  if (!png) return proto::Unexpected(png.error());
  if (auto ok = proto::write_bytes(flags.picture, *png); !ok) return proto::Unexpected(ok.error());
  return picture;
}

int run_view(ViewFlags flags) {
  const Interrupt interrupt;  // made before all threads, which inherit the signal mask
  const auto size = view::parse_size(flags.size);
  if (!size) return report(size.error());
  flags.request.size = *size;
  const auto picture = draw_view(flags, interrupt.token());
  if (!picture) return report(picture.error());
  std::printf("%s: %ux%u, %s", flags.picture.c_str(), picture->width, picture->height,
              flags.request.layer.c_str());
  if (picture->exposure != 1) std::printf(", exposure %.6g", double(picture->exposure));
  std::puts("");
  return kDone;
}

}  // namespace

void add_view(CLI::App& app, Run& run) {
  auto flags = std::make_shared<ViewFlags>();
  view::Request& request = flags->request;
  auto* command = app.add_subcommand("view", "Draw a baked scene with a layer as its color");
  command->add_option("folder", flags->folder, "The folder that a bake has written")
      ->required()
      ->type_name("OUT");
  command->add_option("-o,--out", flags->picture, "The picture to write")
      ->required()
      ->type_name("FILE.png");
  command->add_option("--layer", request.layer, "The layer of the pages to show")
      ->type_name("NAME")
      ->capture_default_str();
  command
      ->add_option("--camera", request.camera,
                   "fit, the name of a camera of the scene, or x,y,z:tx,ty,tz[:degrees]")
      ->type_name("CAMERA")
      ->capture_default_str();
  command->add_option("--size", flags->size, "Pixels of the picture, at most 4096x4096")
      ->type_name("WxH")
      ->capture_default_str();
  command->add_flag("--ortho", request.orthographic,
                    "No perspective; the last number of --camera is then a height in m");
  auto* nearest = command->add_flag("--nearest", request.nearest, "Show texels as squares");
  command->add_flag("--bilinear", flags->bilinear, "Blend between texels (the default)")
      ->excludes(nearest);
  command->add_flag("--shaded", request.shaded,
                    "Show the light that leaves the surface: albedo / pi times irradiance, and "
                    "emission");
  command
      ->add_option("--exposure", request.exposure,
                   "Factor on light before the tone curve; by default a percentile decides")
      ->type_name("FACTOR");
  command
      ->add_option("--scene", flags->scene,
                   "The scene, if the folder has no lit.glb: the file that was baked")
      ->type_name("FILE");
  command->add_option("--threads", flags->threads, "Threads that draw; 0: one per processor")
      ->check(CLI::Range(0u, 1024u))
      ->type_name("N")
      ->envname("LIGHTKILN_THREADS")
      ->capture_default_str();
  command->footer(
      R"(Surfaces are not seen from behind, so one can look into a closed room. docs/layers.md lists the
layers and how their values become colors.

Examples:
  lightkiln view out/ -o light.png
  lightkiln view out/ -o room.png --shaded --camera 0,1,2.5:0,1,0:50 --size 1600x1200
  lightkiln view out/ -o texels.png --layer texel_checker --nearest
  lightkiln view out/ -o plan.png --ortho --camera 0,9,0:0,0,0)");
  command->callback([flags, &run] { run = [flags] { return run_view(*flags); }; });
}

}  // namespace kiln::cli
