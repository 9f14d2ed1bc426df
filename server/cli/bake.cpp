#include "baker/bake.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "baker/image/page_image.h"
#include "baker/output/post.h"
#include "proto/files.h"
#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/compare_passes.h"
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
  std::string out, passes;
  SettingsInput settings;
  unsigned threads = 0;
  bool quiet = false, json = false;
};

proto::Expected<void> make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error) return {};
  return proto::fail("io_error",
                     "can't make the folder " + folder.string() + ": " + error.message());
}

/// Writes the pages after each pass, for `lightkiln compare`.
class PassKeeper {
 public:
  /// @param folder "": keeps nothing
  PassKeeper(std::filesystem::path folder, std::uint32_t dilate)
      : folder_(std::move(folder)), dilate_(dilate) {}

  void keep(const baker::Snapshot& snapshot) {
    if (folder_.empty() || !ok_) return;
    const std::filesystem::path to = folder_ / pass_folder(snapshot.pass);
    ok_ = make_folder(to);
    for (std::uint32_t p = 0; ok_ && p < snapshot.texels->pages.size(); ++p) {
      const auto page = output::compose_page(
          *snapshot.texels, p, [&](std::uint32_t t) { return snapshot.light->irradiance(t); },
          dilate_);
      const image::ExrLayer layer{"irradiance", &page};
      char name[32];
      std::snprintf(name, sizeof name, "page_%02u.exr", unsigned(p));
      ok_ = image::write_exr(to / name, {&layer, 1}, proto::Precision::kFloat,
                             {{{"lightkiln:layers", "irradiance"}}});
    }
  }
  /// Writes what the passes were. Returns the first error.
  proto::Expected<void> finish(const std::vector<proto::PassReport>& passes) {
    if (folder_.empty() || !ok_) return ok_;
    auto reports = nlohmann::json::array();
    for (const auto& pass : passes) reports.push_back(proto::to_json(pass));
    return proto::write_bytes(folder_ / kPassReports, proto::to_text(reports, 1) + "\n");
  }

 private:
  std::filesystem::path folder_;
  std::uint32_t dilate_;
  proto::Expected<void> ok_;
};

/// Forwards the bake's progress and warnings to the progress view.
class Observer : public baker::BakeObserver {
 public:
  Observer(ProgressView& view, PassKeeper& passes) : view_(view), passes_(passes) {}
  void on_snapshot(baker::Snapshot snapshot) override { passes_.keep(snapshot); }
  void on_progress(const proto::JobProgress& p) override { view_.update(p); }
  void on_warning(const proto::Warning& w) override {
    view_.note("warning: " + w.message + (w.pointer.empty() ? "" : " (" + w.pointer + ")"));
  }

 private:
  ProgressView& view_;
  PassKeeper& passes_;
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
  for (const std::string& folder : {flags.out, flags.passes})
    if (!folder.empty())
      if (auto ok = make_folder(folder); !ok) return proto::Unexpected(std::move(ok.error()));
  if (holds_passes(flags.passes))
    return proto::fail("usage", flags.passes +
                                    " holds the passes of another bake: name another "
                                    "folder, or empty it");
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
  PassKeeper passes(flags.passes, input->settings.post.dilate);
  Observer observer(view, passes);
  const auto manifest = baker::bake(*input, pool, interrupt.token(), observer);
  view.finish();
  if (!manifest) return report(manifest.error());
  if (auto ok = passes.finish(manifest->statistics.passes); !ok) return report(ok.error());
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
  command
      ->add_option("--keep-passes", flags->passes,
                   "Folder for the pages after each pass, which `lightkiln compare` reads")
      ->type_name("DIR");
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
