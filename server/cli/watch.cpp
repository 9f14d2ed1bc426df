#include <CLI/CLI.hpp>
#include <memory>

#include "server/cli/commands.h"
#include "server/cli/remote.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct WatchFlags {
  std::string id;
  RemoteFlags remote;
};

int run_watch(const WatchFlags& flags) {
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  const auto job = watch_job(**client, flags.id, flags.remote.quiet);
  return job ? report_end(*job) : report(job.error());
}

}  // namespace

void add_watch(CLI::App& app, Run& run) {
  auto flags = std::make_shared<WatchFlags>();
  auto* command = app.add_subcommand("watch", "Show a job's progress until it ends");
  command->add_option("id", flags->id, "The job")->required()->type_name("ID");
  flags->remote.add_server(*command);
  flags->remote.add_quiet(*command);
  command->footer(
      "A lost connection is taken up again where it broke. Exit codes: 0 the job succeeded; 1 it\n"
      "failed or was canceled, or the service can't be reached; 2 wrong usage.");
  command->callback([flags, &run] { run = [flags] { return run_watch(*flags); }; });
}

}  // namespace kiln::cli
