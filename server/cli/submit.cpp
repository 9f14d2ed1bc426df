#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>

#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/remote.h"
#include "server/cli/report.h"
#include "server/cli/scene_input.h"
#include "server/cli/settings_input.h"

namespace kiln::cli {
namespace {

struct SubmitFlags {
  SceneInput scene;
  std::string out;
  SettingsInput settings;
  std::int32_t priority = 0;
  std::vector<std::string> labels;
  std::optional<std::uint64_t> ttl_seconds;
  bool bake_again = false;
  RemoteFlags remote;
  bool wait = false;
};

proto::Expected<proto::JobOptions> options_of(const SubmitFlags& flags) {
  proto::JobOptions options;
  options.priority = flags.priority;
  options.ttl_seconds = flags.ttl_seconds;
  options.dedupe = !flags.bake_again;
  for (const auto& label : flags.labels) {
    const auto equals = label.find('=');
    if (equals == std::string::npos)
      return proto::fail("invalid_request", "A label is NAME=VALUE, not \"" + label + "\".");
    options.labels[label.substr(0, equals)] = label.substr(equals + 1);
  }
  return options;
}

proto::Expected<clients::Submission> submission_of(const SubmitFlags& flags) {
  auto settings = flags.scene.settings(flags.settings).document();
  if (!settings) return proto::Unexpected(std::move(settings.error()));
  const auto parsed = proto::parse_settings(*settings);
  if (!parsed) return proto::Unexpected(parsed.error());
  auto side = flags.scene.side_files(*parsed);
  if (!side) return proto::Unexpected(std::move(side.error()));
  auto options = options_of(flags);
  if (!options) return proto::Unexpected(std::move(options.error()));
  return clients::Submission{flags.scene.path, std::move(side->files), std::move(*settings),
                             std::move(*options)};
}

int run_submit(const SubmitFlags& flags) {
  const auto submission = submission_of(flags);
  if (!submission) return report(submission.error());
  const auto client = flags.remote.client();
  if (!client) return report(client.error());
  auto job = (*client)->submit(*submission);
  if (!job) return report(job.error());
  if (!flags.wait) {
    std::puts(job->id.c_str());
    return kDone;
  }
  if (!flags.remote.quiet) std::fprintf(stderr, "job %s\n", job->id.c_str());
  job = watch_job(**client, job->id, flags.remote.quiet);
  if (!job) return report(job.error());
  if (const int code = report_end(*job); code != kDone) return code;
  if (flags.out.empty()) return kDone;
  const auto fetched = fetch_results(**client, job->id, flags.out, flags.remote.quiet);
  return fetched ? int{kDone} : report(fetched.error());
}

}  // namespace

void add_submit(CLI::App& app, Run& run) {
  auto flags = std::make_shared<SubmitFlags>();
  auto* command = app.add_subcommand("submit", "Send a scene to a service");
  flags->scene.add_flags(*command);
  flags->settings.add_flags(*command);
  constexpr int kMax = proto::JobOptions::kMaxPriority;
  command
      ->add_option("--priority", flags->priority,
                   "Priority from -100 to 100; a higher one runs first")
      ->check(CLI::Range(-kMax, kMax))
      ->type_name("N")
      ->capture_default_str();
  command
      ->add_option("--label", flags->labels, "A label to find the job by; may be given many times")
      ->type_name("NAME=VALUE")
      ->take_all();
  command
      ->add_option(
          "--ttl-seconds", flags->ttl_seconds,
          "Delete the job this many seconds after it ends; 0: never\n[the service's default]")
      ->type_name("N");
  command->add_flag("--bake-again", flags->bake_again,
                    "Bake even if the service has the result of the same bake");
  auto* wait = command->add_flag("--wait", flags->wait, "Show progress until the job ends");
  command
      ->add_option("-o,--out", flags->out,
                   "Download the results into this folder when the job has succeeded")
      ->needs(wait)
      ->type_name("DIR");
  flags->remote.add_server(*command);
  flags->remote.add_quiet(*command);
  command->footer(
      R"(The files are hashed first; a scene that the service has is not sent again. An upload of 8 MiB or
more that breaks resumes where it was, also when the command is run again.

Without --wait the command prints the job's id and ends. The job runs on, as it does when the
command is interrupted.

Examples:
  lightkiln submit room.glb --wait -o out/
  id=$(lightkiln submit room.glb --set solver.samples=1024) && lightkiln watch $id

Exit codes: 0 the job succeeded (without --wait: was accepted); 1 it failed, or the service can't be
reached; 2 wrong usage or input.)");
  command->callback([flags, &run] { run = [flags] { return run_submit(*flags); }; });
}

}  // namespace kiln::cli
