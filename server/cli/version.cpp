#include <CLI/CLI.hpp>
#include <cstdio>

#include "server/cli/commands.h"
#include "server/cli/report.h"

namespace kiln::cli {

void add_version(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand("version", "Print the version");
  command->callback([&run] {
    run = [] {
      std::puts("lightkiln " LIGHTKILN_VERSION);
      return int{kDone};
    };
  });
}

}  // namespace kiln::cli
