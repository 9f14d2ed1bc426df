#include "server/cli/service_flags.h"

#include <CLI/CLI.hpp>

namespace kiln::cli {
namespace {

void add_row(CLI::App& command, const ConfigRow& row, const std::shared_ptr<ServiceFlags>& flags) {
  base::ServerConfig defaults;
  defaults.data = default_data_folder(process_environment());
  const std::string name(row.name);
  const std::string help = std::string(row.description) + "\n[" + row.show(defaults) + "]";
  command
      .add_option_function<std::string>(
          flag_of(name), [flags, name](const std::string& v) { flags->values[name] = v; }, help)
      ->type_name(row.is_number ? "N" : "VALUE");
}

}  // namespace

proto::Expected<LoadedConfig> ServiceFlags::load() const {
  ConfigSources sources;
  sources.flags = values;
  sources.environment = process_environment();
  if (!config_file.empty()) sources.file = config_file;
  return load_config(sources);
}

std::shared_ptr<ServiceFlags> add_service_flags(CLI::App& command) {
  auto flags = std::make_shared<ServiceFlags>();
  for (const auto& row : config_rows()) add_row(command, row, flags);
  command
      .add_option("--config", flags->config_file,
                  "TOML file with the same names ('max_running_jobs = 4')\n"
                  "[./lightkiln.toml when it exists]")
      ->envname("LIGHTKILN_CONFIG")
      ->type_name("FILE");
  return flags;
}

}  // namespace kiln::cli
