#include "server/cli/remote.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/cli/progress.h"
#include "server/cli/report.h"

namespace kiln::cli {

void RemoteFlags::add_server(CLI::App& app) {
  app.add_option("--server", server, "The service to talk to")
      ->envname("LIGHTKILN_SERVER")
      ->type_name("URL")
      ->capture_default_str();
}

void RemoteFlags::add_quiet(CLI::App& app) {
  app.add_flag("-q,--quiet", quiet, "Say nothing but errors");
}

proto::Expected<std::unique_ptr<clients::Client>> RemoteFlags::client() const {
  auto url = clients::parse_server_url(server);
  if (!url) return proto::Unexpected(std::move(url.error()));
  return std::make_unique<clients::Client>(std::move(*url));
}

namespace {

/// Shows what is known of an event; those of a later version's types are left alone.
void show(const proto::Event& event, ProgressView& view) {
  auto doc = proto::parse_json(event.data, "event");
  if (!doc || !doc->is_object()) {
    view.note("unreadable event " + std::to_string(event.id));
    return;
  }
  if (event.type == "snapshot" || event.type == "job.state") {
    if (const auto job = proto::job_summary_from_json(*doc)) view.update(job->progress);
  } else if (event.type == "job.progress") {
    if (const auto progress = proto::progress_from_json(*doc)) view.update(*progress);
  } else if (event.type == "log" && doc->contains("message") && (*doc)["message"].is_string()) {
    view.note((*doc)["message"].get<std::string>());
  }
}

}  // namespace

proto::Expected<proto::JobSummary> watch_job(clients::Client& client, const std::string& id,
                                             bool quiet) {
  ProgressView view(ProgressView::style_for(quiet));
  const auto followed = client.follow(id, 0, [&](const proto::Event& event) {
    show(event, view);
    return true;
  });
  view.finish();
  if (!followed) return proto::Unexpected(followed.error());
  return client.job(id);
}

proto::Expected<void> fetch_results(clients::Client& client, const std::string& id,
                                    const std::string& dir, bool quiet) {
  const auto files = client.results(id);
  if (!files) return proto::Unexpected(files.error());
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error)
    return proto::fail("io_error", "can't make the folder " + dir + ": " + error.message());
  for (const auto& file : *files) {
    if (auto ok = client.download(id, file, dir); !ok) return ok;
    if (!quiet) std::puts((std::filesystem::path(dir) / file.name).c_str());
  }
  return {};
}

int report_end(const proto::JobSummary& job) {
  if (job.state == proto::JobState::kSucceeded) return kDone;
  if (job.error) std::fputs(error_text(*job.error).c_str(), stderr);
  std::fprintf(stderr, "lightkiln: job %s %s\n", job.id.c_str(), to_string(job.state));
  return kFailed;
}

}  // namespace kiln::cli
