#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/settings_schema.h"
#include "server/cli/commands.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct SettingsFlags {
  bool schema = false, defaults = false;
};

template <class Owner>
void print_row(const proto::SettingRow<Owner>& row, const std::string& prefix) {
  const auto& spec = row.spec;
  std::printf("%s%s = %s\n    %s%s\n    %s\n", prefix.c_str(), std::string(spec.path).c_str(),
              proto::to_text(row.read(Owner{}, spec)).c_str(), proto::expectation(spec).c_str(),
              spec.unit.empty() ? "" : ("; " + std::string(spec.unit)).c_str(),
              std::string(spec.description).c_str());
}

void print_table() {
  std::puts(
      "Each setting with its default. In JSON the dots are objects: {\"solver\": {\"samples\": "
      "64}}.\n");
  for (const auto& row : proto::setting_rows()) print_row(row, "");
  std::puts(
      "\nlights is a list of lights beside those of the scene. Each has a type and keys of "
      "that type:\n");
  for (const auto& row : proto::light_rows()) print_row(row, "lights.N.");
}

int run_settings(const SettingsFlags& flags) {
  if (flags.schema)
    std::puts(proto::to_text(proto::settings_schema(), 2).c_str());
  else if (flags.defaults)
    std::puts(proto::to_text(proto::to_json(proto::BakeSettings{}), 2).c_str());
  else
    print_table();
  return kDone;
}

}  // namespace

void add_settings(CLI::App& app, Run& run) {
  auto flags = std::make_shared<SettingsFlags>();
  auto* command = app.add_subcommand("settings", "List the settings of a bake");
  auto* schema = command->add_flag("--schema", flags->schema, "Print them as a JSON Schema");
  command->add_flag("--defaults", flags->defaults, "Print the defaults as a settings file")
      ->excludes(schema);
  command->footer(R"(Examples:
  lightkiln settings
  lightkiln settings --defaults > bake.json
  lightkiln bake room.glb -o out/ --settings bake.json --set solver.samples=64)");
  command->callback([flags, &run] { run = [flags] { return run_settings(*flags); }; });
}

}  // namespace kiln::cli
