#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/remote.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct CancelFlags {
  std::string id;
  RemoteFlags remote;
};

int run_cancel(const CancelFlags& flags) {
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  const auto job = (*client)->cancel(flags.id);
  if (!job) return report(job.error());
  std::puts(proto::to_string(job->state));
  return kDone;
}

}  // namespace

void add_cancel(CLI::App& app, Run& run) {
  auto flags = std::make_shared<CancelFlags>();
  auto* command = app.add_subcommand("cancel", "Stop a job");
  command->add_option("id", flags->id, "The job")->required()->type_name("ID");
  flags->remote.add_server(*command);
  command->footer("Prints the job's state. A job that has ended stays as it is.");
  command->callback([flags, &run] { run = [flags] { return run_cancel(*flags); }; });
}

}  // namespace kiln::cli
