#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/progress.h"
#include "server/cli/remote.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct StatusFlags {
  std::string id;
  RemoteFlags remote;
};

void print_row(const proto::JobSummary& job) {
  std::printf("%s  %-10s  %3d %%  %s\n", job.id.c_str(), to_string(job.state),
              static_cast<int>(job.progress.fraction * 100), job.created_at.c_str());
}

void print_job(const proto::JobSummary& job) {
  std::printf("job       %s\nstate     %s\nprogress  %d %%", job.id.c_str(), to_string(job.state),
              static_cast<int>(job.progress.fraction * 100));
  if (!proto::is_terminal(job.state)) std::printf(" (%s)", progress_words(job.progress).c_str());
  std::printf("\nscene     sha256:%s, %llu bytes\n", job.scene_sha256.c_str(),
              static_cast<unsigned long long>(job.scene_bytes));
  if (job.attempt > 1) std::printf("attempt   %u\n", job.attempt);
  for (const auto& [word, time] :
       {std::pair("created ", &job.created_at), std::pair("started ", &job.started_at),
        std::pair("finished", &job.finished_at)})
    if (!time->empty()) std::printf("%s  %s\n", word, time->c_str());
  if (job.error) std::printf("error     %s", error_text(*job.error).c_str());
}

int run_status(const StatusFlags& flags) {
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  if (!flags.id.empty()) {
    const auto job = (*client)->job(flags.id);
    if (!job) return report(job.error());
    print_job(*job);
    return kDone;
  }
  const auto jobs = (*client)->jobs();
  if (!jobs) return report(jobs.error());
  for (const auto& job : *jobs) print_row(job);
  return kDone;
}

}  // namespace

void add_status(CLI::App& app, Run& run) {
  auto flags = std::make_shared<StatusFlags>();
  auto* command = app.add_subcommand("status", "Show a job, or the newest 50");
  command->add_option("id", flags->id, "The job; without it, the newest 50 are listed")
      ->type_name("ID");
  flags->remote.add_server(*command);
  command->footer("The exit code is 0 when the service answers, whatever the job's state.");
  command->callback([flags, &run] { run = [flags] { return run_status(*flags); }; });
}

}  // namespace kiln::cli
