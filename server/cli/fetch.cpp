#include <CLI/CLI.hpp>
#include <memory>

#include "server/cli/commands.h"
#include "server/cli/remote.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct FetchFlags {
  std::string id, out;
  RemoteFlags remote;
};

int run_fetch(const FetchFlags& flags) {
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  const auto fetched = fetch_results(**client, flags.id, flags.out, flags.remote.quiet);
  return fetched ? int{kDone} : report(fetched.error());
}

}  // namespace

void add_fetch(CLI::App& app, Run& run) {
  auto flags = std::make_shared<FetchFlags>();
  auto* command = app.add_subcommand("fetch", "Download the results of a job");
  command->add_option("id", flags->id, "The job")->required()->type_name("ID");
  command->add_option("-o,--out", flags->out, "Folder for the results; created when missing")
      ->required()
      ->type_name("DIR");
  flags->remote.add_server(*command);
  flags->remote.add_quiet(*command);
  command->footer(
      "Each file is checked against its SHA-256 and appears only when it is whole. Files that are\n"
      "already there and right are not downloaded again.");
  command->callback([flags, &run] { run = [flags] { return run_fetch(*flags); }; });
}

}  // namespace kiln::cli
