#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "proto/job.h"
#include "proto/manifest.h"

namespace kiln::base {

/// Counts what the service does, and writes it in Prometheus' text format. Thread-safe; a count
/// takes microseconds.
class Metrics {
 public:
  Metrics();
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  /// Counts a request that was answered, or whose client has gone: 499. `route` is the pattern,
  /// never the path, which would be a series per job.
  void request(std::string_view method, std::string_view route, int status, double seconds);
  void job_started(double seconds_in_queue);
  void job_ended(proto::JobState);
  void pass_done(const proto::PassReport&);
  void webhook(std::string_view outcome);  ///< a try: delivered, retried, failed
  void committed(double seconds);          ///< one transaction of the job store
  /// Counts a request of visibility that was answered. `was_ready`: it did not make its scene so.
  void visibility(std::uint64_t pairs, bool was_ready);

  /// The figures that are looked up when metrics are read.
  struct Now {
    std::size_t queued = 0, running = 0, streams = 0;
    std::uint64_t webhooks = 0;  ///< messages that are not delivered
    std::size_t waiting = 0;     ///< requests that wait for a job
    std::size_t uploads = 0;     ///< requests whose body is arriving
    std::uint64_t dropped_streams = 0, disk_bytes = 0;
    double disk_free_share = 0;
    std::size_t connections = 0;
    std::uint64_t memory_budget = 0, memory_reserved = 0, memory_spare = 0;
  };
  std::string text(const Now&);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kiln::base
