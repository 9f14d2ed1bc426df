#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "baker/generate/generate.h"
#include "clients/verified_file.h"
#include "server/cli/commands.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct SceneFlags {
  std::string name, out;
  std::uint32_t detail = 0;
  bool list = false;
};

int print_list() {
  for (const auto& g : generate::generators())
    std::printf("%-18s %s\n", std::string(g.name).c_str(), std::string(g.description).c_str());
  return kDone;
}

proto::Expected<void> write_scene(const SceneFlags& flags) {
  auto glb = generate::generate_glb(flags.name, flags.detail);
  if (!glb) return proto::Unexpected(std::move(glb.error()));
  clients::VerifiedFile file(std::filesystem::absolute(flags.out));
  if (auto ok = file.open(); !ok) return ok;
  file.write(*glb);
  return file.commit("");
}

int run_scene(const SceneFlags& flags) {
  if (flags.list) return print_list();
  if (flags.name.empty() || flags.out.empty())
    return report({"usage", "a NAME and -o FILE are needed, or --list", {}});
  if (auto ok = write_scene(flags); !ok) return report(ok.error());
  return kDone;
}

}  // namespace

void add_scene(CLI::App& app, Run& run) {
  auto flags = std::make_shared<SceneFlags>();
  auto* command = app.add_subcommand("scene", "Write a generated test scene");
  command->add_option("name", flags->name, "A name that --list prints")->type_name("NAME");
  command->add_option("-o,--out", flags->out, "The .glb to write")->type_name("FILE");
  command
      ->add_option("--detail", flags->detail,
                   "Fineness of curved and bumpy parts; 0: the scene's default")
      ->check(CLI::Range(0u, 4096u))
      ->capture_default_str();
  command->add_flag("--list", flags->list, "List the scenes");
  command->footer(R"(Examples:
  lightkiln scene --list
  lightkiln scene cornell -o cornell.glb)");
  command->callback([flags, &run] { run = [flags] { return run_scene(*flags); }; });
}

}  // namespace kiln::cli
