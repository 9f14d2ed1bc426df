#include "server/serve.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "server/cli/commands.h"
#include "server/cli/config.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct ServeFlags {
  std::map<std::string, std::string> values;  ///< by row name; those that were given
  std::string config_file;
  bool print_config = false;
};

int run_serve(const ServeFlags& flags) {
  ConfigSources sources;
  sources.flags = flags.values;
  sources.environment = process_environment();
  if (!flags.config_file.empty()) sources.file = flags.config_file;
  const auto loaded = load_config(sources);
  if (!loaded) return report(loaded.error());
  if (flags.print_config) {
    std::fputs(config_text(*loaded).c_str(), stdout);
    return kDone;
  }
  return server::serve(loaded->config);
}

void add_row(CLI::App& command, const ConfigRow& row, const std::shared_ptr<ServeFlags>& flags) {
  server::ServerConfig defaults;
  defaults.data = default_data_folder(process_environment());
  const std::string name(row.name);
  const std::string help = std::string(row.description) + "\n[" + row.show(defaults) + "]";
  command
      .add_option_function<std::string>(
          flag_of(name), [flags, name](const std::string& v) { flags->values[name] = v; }, help)
      ->type_name(row.is_number ? "N" : "VALUE");
}

}  // namespace

void add_serve(CLI::App& app, Run& run) {
  auto flags = std::make_shared<ServeFlags>();
  auto* command = app.add_subcommand("serve", "Run the HTTP service");
  for (const auto& row : config_rows()) add_row(*command, row, flags);
  command
      ->add_option("--config", flags->config_file,
                   "TOML file with the same names ('max_running_jobs = 4')\n"
                   "[./lightkiln.toml when it exists]")
      ->envname("LIGHTKILN_CONFIG")
      ->type_name("FILE");
  command->add_flag("--print-config", flags->print_config,
                    "Print what results from flags, variables and file, as TOML, and exit");
  command->footer(
      R"(A flag beats its variable (--port: LIGHTKILN_PORT), which beats the TOML file. Unknown names are
errors in all three.

Examples:
  lightkiln serve
  lightkiln serve --listen 0.0.0.0 --port 80 --data /var/lib/lightkiln --log-format json
  LIGHTKILN_MAX_RUNNING_JOBS=4 lightkiln serve --print-config

Then, from anywhere that reaches it:
  curl -F scene=@room.glb http://127.0.0.1:8080/v1/jobs

SIGTERM or Ctrl-C drains it. Exit codes: 0 drained, 1 could not start, 2 wrong configuration.)");
  command->callback([flags, &run] { run = [flags] { return run_serve(*flags); }; });
}

}  // namespace kiln::cli
