#include "server/serve.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/commands.h"
#include "server/cli/config.h"
#include "server/cli/report.h"
#include "server/cli/service_flags.h"

namespace kiln::cli {
namespace {

int run_serve(const ServiceFlags& flags, bool print_config) {
  const auto loaded = flags.load();
  if (!loaded) return report(loaded.error());
  if (print_config) {
    std::fputs(config_text(*loaded).c_str(), stdout);
    return kDone;
  }
  return server::serve(loaded->config);
}

}  // namespace

void add_serve(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand("serve", "Run the HTTP service");
  const auto flags = add_service_flags(*command);
  const auto print_config = std::make_shared<bool>(false);
  command->add_flag(
      "--print-config", *print_config,
      "Print the configuration that flags, variables and file give, as TOML, and exit");
  command->footer(
      R"(A flag overrides its variable (--port: LIGHTKILN_PORT), which overrides the TOML file. Unknown
names are errors in all three.

Examples:
  lightkiln serve
  lightkiln serve --listen 0.0.0.0 --port 80 --data /var/lib/lightkiln --log-format json
  LIGHTKILN_MAX_RUNNING_JOBS=4 lightkiln serve --print-config

Then, from anywhere that reaches it:
  curl -F scene=@room.glb http://127.0.0.1:8080/v1/jobs

SIGTERM or Ctrl-C drains the service. Exit codes: 0 drained, 1 could not start, 2 wrong
configuration.)");
  command->callback([flags, print_config, &run] {
    run = [flags, print_config] { return run_serve(*flags, *print_config); };
  });
}

}  // namespace kiln::cli
