#include <CLI/CLI.hpp>

#include "server/cli/commands.h"
#include "server/sandbox/child.h"
#include "server/sandbox/zygote.h"

namespace kiln::cli {

void add_import_stage(CLI::App& app, Run& run) {
  const auto add = [&](const char* name, void (*process)(int parent)) {
    auto parent = std::make_shared<int>(0);
    auto* command = app.add_subcommand(name, "");
    command->group("");  // not for people, so the help leaves it out
    command->add_option("PID", *parent)->required();
    command->callback([parent, process, &run] {
      run = [parent, process]() -> int {
        process(*parent);
        return 1;  // it does not return
      };
    });
  };
  add("import-stage", sandbox::run_import_stage);
  add("import-zygote", sandbox::run_import_zygote);
}

}  // namespace kiln::cli
