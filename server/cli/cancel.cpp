#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/remote.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct ActionFlags {
  std::string id;
  bool keep = false, from_start = false;
  RemoteFlags remote;
};

int run_cancel(const ActionFlags& flags) {
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  const auto job = (*client)->cancel(flags.id, flags.keep);
  if (!job) return report(job.error());
  std::puts(proto::to_string(job->state));
  return kDone;
}

int run_retry(const ActionFlags& flags) {
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  const auto job = (*client)->retry(flags.id, flags.from_start);
  if (!job) return report(job.error());
  std::puts(proto::to_string(job->state));
  return kDone;
}

}  // namespace

void add_cancel(CLI::App& app, Run& run) {
  auto flags = std::make_shared<ActionFlags>();
  auto* command = app.add_subcommand("cancel", "Stop a job");
  command->add_option("id", flags->id, "The job")->required()->type_name("ID");
  command->add_flag("--keep", flags->keep, "Turn the passes that are done into the result");
  flags->remote.add_server(*command);
  command->footer("Prints the job's state. A job that has ended stays as it is.");
  command->callback([flags, &run] { run = [flags] { return run_cancel(*flags); }; });
}

void add_retry(CLI::App& app, Run& run) {
  auto flags = std::make_shared<ActionFlags>();
  auto* command = app.add_subcommand("retry", "Run a failed or canceled job again");
  command->add_option("id", flags->id, "The job")->required()->type_name("ID");
  command->add_flag("--from-start", flags->from_start,
                    "Run all passes again instead of resuming after the last one");
  flags->remote.add_server(*command);
  command->footer("Prints the job's state; `lightkiln watch` shows its progress.");
  command->callback([flags, &run] { run = [flags] { return run_retry(*flags); }; });
}

}  // namespace kiln::cli
