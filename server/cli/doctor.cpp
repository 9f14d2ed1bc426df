#include "server/doctor.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/report.h"
#include "server/cli/service_flags.h"
#include "server/store/database.h"

namespace kiln::cli {
namespace {

void print(const std::vector<server::Finding>& findings) {
  for (const auto& f : findings) {
    std::printf("%-4s  %-11s  %s\n", server::to_string(f.health), f.name.c_str(), f.value.c_str());
    if (!f.advice.empty()) std::printf("      %s\n", f.advice.c_str());
  }
}

int run_doctor(const ServiceFlags& flags, bool as_json) {
  const auto loaded = flags.load();
  if (!loaded) return report(loaded.error());
  try {
    const auto findings = server::examine(loaded->config);
    if (as_json)
      std::puts(proto::to_text(server::to_json(findings), 2).c_str());
    else
      print(findings);
    return server::worst(findings) == server::Health::kFail ? kFailed : kDone;
  } catch (const store::DatabaseError& e) {
    return report({"io_error", e.what(), {}});
  }
}

}  // namespace

void add_doctor(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand("doctor", "Check whether this machine can run the service");
  const auto flags = add_service_flags(*command);
  const auto as_json = std::make_shared<bool>(false);
  command->add_flag("--json", *as_json, "Print a JSON document instead of lines");
  command->footer(
      R"(Takes the flags of `serve` and checks the machine for that service: processor, memory, disk,
descriptors, ports, tokens, clock, SQLite, image module. While the service runs, its ports are in use.

Exit codes: 0 it can (warnings are only printed), 1 something must be fixed first, 2 wrong
configuration.)");
  command->callback(
      [flags, as_json, &run] { run = [flags, as_json] { return run_doctor(*flags, *as_json); }; });
}

}  // namespace kiln::cli
