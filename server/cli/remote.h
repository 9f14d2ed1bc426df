#pragma once

#include <memory>
#include <string>

#include "clients/client.h"
#include "proto/expected.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// The flags that all commands share which talk to a service.
struct RemoteFlags {
  std::string server = clients::kDefaultServer;
  std::string token_file;
  bool quiet = false;

  void add_server(CLI::App&);
  void add_quiet(CLI::App&);
  proto::Expected<std::unique_ptr<clients::Client>> client() const;
};

/// Shows a job's progress until it ends. Returns the job as it is then.
proto::Expected<proto::JobSummary> watch_job(clients::Client&, const std::string& id, bool quiet);

/// Downloads all results into `dir`, which it creates when missing. Prints the files' paths unless
/// `quiet` is set.
proto::Expected<void> fetch_results(clients::Client&, const std::string& id, const std::string& dir,
                                    bool quiet);

/// Reports on stderr how a job ended, unless it succeeded. Returns the exit code for it.
int report_end(const proto::JobSummary&);

}  // namespace kiln::cli
