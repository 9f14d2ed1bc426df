#include "server/cli/remote.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "proto/files.h"
#include "proto/json.h"
#include "server/cli/progress.h"
#include "server/cli/report.h"

namespace kiln::cli {

namespace {

// Reads the token. It is no flag, since every user of a machine sees the others' command lines.
proto::Expected<std::string> token(const std::string& file) {
  constexpr std::uint64_t kMaxBytes = 4096;
  std::string text;
  if (!file.empty()) {
    auto content = proto::read_file(file, kMaxBytes);
    if (!content) return content;
    text = std::move(*content);
  } else if (const char* variable = std::getenv("LIGHTKILN_TOKEN")) {
    text = variable;
  }
  const auto blank = [](unsigned char c) { return c <= ' '; };
  text.erase(std::remove_if(text.begin(), text.end(), blank), text.end());
  return text;
}

}  // namespace

void RemoteFlags::add_server(CLI::App& app) {
  app.add_option("--server", server, "The service to talk to")
      ->envname("LIGHTKILN_SERVER")
      ->type_name("URL")
      ->capture_default_str();
  app.add_option("--token-file", token_file,
                 "File with the token for the service, if it needs one\n"
                 "[the token in the variable LIGHTKILN_TOKEN]")
      ->type_name("FILE");
}

void RemoteFlags::add_quiet(CLI::App& app) {
  app.add_flag("-q,--quiet", quiet, "Print errors only");
}

proto::Expected<std::unique_ptr<clients::Client>> RemoteFlags::client() const {
  auto url = clients::parse_server_url(server);
  if (!url) return proto::Unexpected(std::move(url.error()));
  auto secret = token(token_file);
  if (!secret) return proto::Unexpected(std::move(secret.error()));
  return std::make_unique<clients::Client>(std::move(*url), std::move(*secret));
}

namespace {

/// Shows an event. Types of a later version are ignored.
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
    return proto::fail("io_error",
                       "The folder " + dir + " can't be made: " + error.message() + ".");
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
