#pragma once

#include <memory>
#include <string>

#include "clients/client.h"
#include "proto/expected.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// What the commands that talk to a service have in common.
struct RemoteFlags {
  std::string server = clients::kDefaultServer;
  std::string token_file;
  bool quiet = false;

  void add_server(CLI::App&);
  void add_quiet(CLI::App&);
  proto::Expected<std::unique_ptr<clients::Client>> client() const;
};

/// Shows a job's progress until it ends; the job as it then is.
proto::Expected<proto::JobSummary> watch_job(clients::Client&, const std::string& id, bool quiet);

/// Downloads all results into `dir`, made when missing, and prints the files' paths unless quiet.
proto::Expected<void> fetch_results(clients::Client&, const std::string& id, const std::string& dir,
                                    bool quiet);

/// Says how a job ended, on stderr unless it succeeded; the exit code that belongs to it.
int report_end(const proto::JobSummary&);

}  // namespace kiln::cli
