#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <memory>

#include "server/cli/commands.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

constexpr const char* kAbout =
    "Lightkiln bakes lightmaps: a glTF scene goes in, OpenEXR lightmaps and a lit glTF come out.";

constexpr const char* kFooter = R"(Examples:
  lightkiln scene cornell -o cornell.glb       write a scene to try things on
  lightkiln bake cornell.glb -o out/           bake it here, without a service
  lightkiln serve                              run the service on http://127.0.0.1:8080
  lightkiln submit cornell.glb --wait -o out/  bake it there
  curl -F scene=@cornell.glb http://127.0.0.1:8080/v1/jobs

`lightkiln COMMAND --help` explains a command; `lightkiln settings` lists the settings of a bake.

Exit codes: 0 done; 1 the job failed, or the service can't be reached; 2 wrong usage or input.)";

}  // namespace

int run_program(int argc, char** argv) {
  CLI::App app(kAbout, "lightkiln");
  app.footer(kFooter);
  app.require_subcommand(1);
  app.set_version_flag("--version", "lightkiln " LIGHTKILN_VERSION);
  app.get_formatter()->column_width(34);
  Run run;
  for (const auto add : {add_serve, add_bake, add_scene, add_compare, add_view, add_visibility,
                         add_submit, add_status, add_watch, add_cancel, add_retry, add_fetch,
                         add_settings, add_token, add_doctor, add_version, add_import_stage})
    add(app, run);
  if (argc < 2) {
    std::fputs(app.help().c_str(), stderr);
    return kUsage;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {  // the library also reports --help so
    return app.exit(e) == 0 ? kDone : kUsage;
  }
  try {
    return run();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "lightkiln: internal error: %s\n", e.what());
    return kFailed;
  }
}

}  // namespace kiln::cli
