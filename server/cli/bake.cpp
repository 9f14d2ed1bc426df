#include "baker/bake.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "proto/files.h"
#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/interrupt.h"
#include "server/cli/progress.h"
#include "server/cli/report.h"
#include "server/cli/scene_input.h"
#include "server/cli/settings_input.h"
#include "server/sandbox/image_process.h"
#include "server/sandbox/importer.h"

namespace kiln::cli {
namespace {

struct BakeFlags {
  SceneInput scene;
  std::string out;
  SettingsInput settings;
  unsigned threads = 0;
  bool quiet = false, json = false;
};

/// Forwards the bake's progress and warnings to the progress view.
class Observer : public baker::BakeObserver {
 public:
  explicit Observer(ProgressView& view) : view_(view) {}
  void on_progress(const proto::JobProgress& p) override { view_.update(p); }
  void on_warning(const proto::Warning& w) override {
    view_.note("warning: " + w.message + (w.pointer.empty() ? "" : " (" + w.pointer + ")"));
  }

 private:
  ProgressView& view_;
};

proto::Expected<baker::BakeInput> input_of(const BakeFlags& flags,
                                           const std::shared_ptr<sandbox::Zygote>& zygote) {
  baker::BakeInput input;
  auto settings = flags.scene.settings(flags.settings).settings();
  if (!settings) return proto::Unexpected(std::move(settings.error()));
  input.settings = std::move(*settings);
  std::error_code error;
  if (!std::filesystem::is_regular_file(flags.scene.path, error))
    return proto::fail("missing_file", "there is no file " + flags.scene.path);
  auto digest = proto::digest_file(flags.scene.path);
  if (!digest) return proto::Unexpected(std::move(digest.error()));
  input.scene_sha256 = std::move(digest->sha256);
  auto side = flags.scene.side_files(input.settings);
  if (!side) return proto::Unexpected(std::move(side.error()));
  input.files = {flags.scene.path, std::move(side->files), input.settings.sky.map};
  // The scene takes the service's path, without its limits: the user has chosen the scene and the
  // machine.
  sandbox::Importer::Options importing;
  importing.process.zygote = zygote;
  importing.decodes_images = side->images;
  input.source = sandbox::Importer(importing).open(input.files, input.scene_key, {});
  std::filesystem::create_directories(flags.out, error);
  if (error)
    return proto::fail("io_error", "can't make the folder " + flags.out + ": " + error.message());
  input.output_dir = flags.out;
  return input;
}

void print_summary(const BakeFlags& flags, const proto::Manifest& manifest) {
  if (flags.json) {
    std::puts(proto::to_text(proto::to_json(manifest), 2).c_str());
    return;
  }
  if (flags.quiet) return;
  const std::filesystem::path dir(flags.out);
  bool listed = false;  // a manifest can't hold its own digest, so its list may omit it
  for (const auto& file : manifest.files) {
    std::puts((dir / file.name).c_str());
    listed |= file.name == "manifest.json";
  }
  if (!listed) std::puts((dir / "manifest.json").c_str());
}

int run_bake(const BakeFlags& flags) {
  const Interrupt interrupt;  // made before all threads, which inherit the signal mask
  // It opens the image module while the scene is read. This process never does.
  const auto zygote = std::make_shared<sandbox::Zygote>(sandbox::Zygote::Options{});
  const sandbox::ImageProcesses images({.zygote = zygote});
  auto input = input_of(flags, zygote);
  if (!input) return report(input.error());
  const unsigned threads =
      flags.threads != 0 ? flags.threads : std::max(1u, std::thread::hardware_concurrency());
  exec::ThreadPool pool(threads);
  ProgressView view(ProgressView::style_for(flags.quiet));
  Observer observer(view);
  const auto manifest = baker::bake(*input, pool, interrupt.token(), observer);
  view.finish();
  if (!manifest) return report(manifest.error());
  print_summary(flags, *manifest);
  return kDone;
}

}  // namespace

void add_bake(CLI::App& app, Run& run) {
  auto flags = std::make_shared<BakeFlags>();
  auto* command = app.add_subcommand("bake", "Bake a scene here, without a service");
  flags->scene.add_flags(*command);
  command->add_option("-o,--out", flags->out, "Folder for the results; created when missing")
      ->required()
      ->type_name("DIR");
  flags->settings.add_flags(*command);
  command->add_option("--threads", flags->threads, "Threads that bake; 0: one per processor")
      ->check(CLI::Range(0u, 1024u))
      ->type_name("N")
      ->envname("LIGHTKILN_THREADS")
      ->capture_default_str();
  command->add_flag("-q,--quiet", flags->quiet, "Print errors only");
  command->add_flag("--json", flags->json, "Print manifest.json on stdout");
  command->footer(R"(Examples:
  lightkiln bake room.glb -o out/
  lightkiln bake room.gltf -o out/ --set solver.samples=64 --set atlas.page_size=512
  lightkiln bake dark.glb -o out/ --set sky.radiance=[1,1,1]
  lightkiln bake yard.glb -o out/ --sky noon_4k.exr --set sky.scale=20000
  lightkiln bake room.glb -o out/ --settings bake.json --json > manifest.json

Writes page_NN.exr (irradiance in lux), page_NN.png (previews), lit.glb and manifest.json, exactly
as the service would return them.)");
  command->callback([flags, &run] { run = [flags] { return run_bake(*flags); }; });
}

}  // namespace kiln::cli
