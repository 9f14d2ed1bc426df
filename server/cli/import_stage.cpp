#include <CLI/CLI.hpp>

#include "server/cli/commands.h"
#include "server/sandbox/child.h"

namespace kiln::cli {

void add_import_stage(CLI::App& app, Run& run) {
  auto parent = std::make_shared<int>(0);
  auto* command = app.add_subcommand("import-stage", "");
  command->group("");  // not for people, so the help leaves it out
  command->add_option("PID", *parent)->required();
  command->callback(
      [parent, &run] { run = [parent]() -> int { sandbox::run_import_stage(*parent); }; });
}

}  // namespace kiln::cli
