#include "server/base/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "baker/bake.h"
#include "proto/json.h"

namespace kiln::base {
namespace {

using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;

using Bounds = Histogram::BucketBoundaries;
const Bounds kFast{0.001, 0.005, 0.025, 0.1, 0.5, 2.5, 10, 60};
const Bounds kSlow{0.1, 1, 5, 30, 120, 600, 3600, 14'400};

Family<Counter>& counter(prometheus::Registry& r, const char* name, const char* help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(r);
}
Family<Gauge>& gauge(prometheus::Registry& r, const char* name, const char* help) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(r);
}
Family<Histogram>& histogram(prometheus::Registry& r, const char* name, const char* help) {
  return prometheus::BuildHistogram().Name(name).Help(help).Register(r);
}

double resident_bytes() {
  std::uint64_t size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return double(resident) * double(::sysconf(_SC_PAGESIZE));
}

double open_descriptors() {
  std::error_code error;
  const std::filesystem::directory_iterator all("/proc/self/fd", error), end;
  return error ? 0 : double(std::distance(all, end));
}

}  // namespace

struct Metrics::Impl {
  prometheus::Registry registry;
  Family<Counter>& requests =
      counter(registry, "http_requests_total", "Requests by route and status");
  Family<Histogram>& request_seconds =
      histogram(registry, "http_request_seconds", "From a request's head to its answer");
  Family<Counter>& jobs_ended = counter(registry, "bake_jobs_ended_total", "Jobs by final state");
  Family<Gauge>& jobs = gauge(registry, "bake_jobs", "Jobs that wait and that run");
  Gauge& queued = jobs.Add({{"state", "queued"}});
  Gauge& running = jobs.Add({{"state", "running"}});
  Histogram& queue_seconds =
      histogram(registry, "bake_queue_seconds", "From a job's arrival to its start").Add({}, kSlow);
  Family<Histogram>& pass_seconds = histogram(registry, "bake_pass_seconds", "Passes by name");
  Counter& rays = counter(registry, "bake_rays_total", "Rays traced").Add({});
  Counter& pairs =
      counter(registry, "visibility_pairs_total", "Pairs of points that were answered").Add({});
  Family<Counter>& visibility_scenes =
      counter(registry, "visibility_scenes_total", "Scenes of such requests: kept, or made ready");
  Gauge& spare =
      gauge(registry, "visibility_kept_bytes", "Memory of scenes that wait for more").Add({});
  Histogram& commit_seconds =
      histogram(registry, "store_commit_seconds", "Transactions of the job store").Add({}, kFast);
  Gauge& streams = gauge(registry, "sse_clients", "Open event streams").Add({});
  Gauge& dropped =
      gauge(registry, "sse_dropped", "Event streams that fell behind, since the start").Add({});
  Family<Counter>& webhooks =
      counter(registry, "webhook_tries_total", "Tries to deliver a message, by outcome");
  Gauge& webhooks_pending =
      gauge(registry, "webhook_pending", "Messages that are not delivered yet").Add({});
  Gauge& disk_bytes = gauge(registry, "data_bytes", "Scenes and jobs on the disk").Add({});
  Gauge& disk_free =
      gauge(registry, "disk_free_share", "Of the data folder's disk, 0 to 1").Add({});
  Gauge& budget =
      gauge(registry, "memory_budget_bytes", "That running bakes and import processes may take")
          .Add({});
  Gauge& reserved =
      gauge(registry, "memory_reserved_bytes", "That running bakes were let in for").Add({});
  Gauge& connections =
      gauge(registry, "http_connections", "Open connections to the API, streams too").Add({});
  Gauge& waiting =
      gauge(registry, "http_waiting", "Requests that wait for a job, or to be read").Add({});
  Gauge& uploads = gauge(registry, "http_uploads", "Requests whose body is arriving").Add({});
  Gauge& descriptors = gauge(registry, "process_open_fds", "Open descriptors").Add({});
  Gauge& memory = gauge(registry, "process_resident_memory_bytes", "Memory in use").Add({});

  Impl() {
    gauge(registry, "build_info", "1, with what was built as labels")
        .Add({{"version", LIGHTKILN_VERSION}, {"instruction_set", baker::instruction_set()}})
        .Set(1);
  }
};

Metrics::Metrics() : impl_(std::make_unique<Impl>()) {}
Metrics::~Metrics() = default;

void Metrics::request(std::string_view method, std::string_view route, int status, double seconds) {
  const std::string what(route.empty() ? "none" : route), how(method);
  impl_->requests.Add({{"method", how}, {"route", what}, {"code", std::to_string(status)}})
      .Increment();
  impl_->request_seconds.Add({{"method", how}, {"route", what}}, kFast).Observe(seconds);
}

void Metrics::job_started(double seconds_in_queue) {
  impl_->queue_seconds.Observe(seconds_in_queue);
}

void Metrics::job_ended(proto::JobState state) {
  impl_->jobs_ended.Add({{"state", proto::to_string(state)}}).Increment();
}

void Metrics::pass_done(const proto::PassReport& pass) {
  impl_->pass_seconds.Add({{"pass", pass.name}}, kSlow).Observe(pass.seconds);
  impl_->rays.Increment(double(pass.rays));
}

void Metrics::webhook(std::string_view outcome) {
  impl_->webhooks.Add({{"outcome", std::string(outcome)}}).Increment();
}

void Metrics::committed(double seconds) {
  impl_->commit_seconds.Observe(seconds);
}

void Metrics::visibility(std::uint64_t pairs, bool was_ready) {
  impl_->pairs.Increment(double(pairs));
  impl_->visibility_scenes.Add({{"scene", was_ready ? "kept" : "made"}}).Increment();
}

std::string Metrics::text(const Now& now) {
  impl_->queued.Set(double(now.queued));
  impl_->running.Set(double(now.running));
  impl_->streams.Set(double(now.streams));
  impl_->dropped.Set(double(now.dropped_streams));
  impl_->webhooks_pending.Set(double(now.webhooks));
  impl_->disk_bytes.Set(double(now.disk_bytes));
  impl_->disk_free.Set(now.disk_free_share);
  impl_->budget.Set(double(now.memory_budget));
  impl_->reserved.Set(double(now.memory_reserved));
  impl_->spare.Set(double(now.memory_spare));
  impl_->connections.Set(double(now.connections));
  impl_->waiting.Set(double(now.waiting));
  impl_->uploads.Set(double(now.uploads));
  impl_->descriptors.Set(open_descriptors());
  impl_->memory.Set(resident_bytes());
  return prometheus::TextSerializer().Serialize(impl_->registry.Collect());
}

}  // namespace kiln::base
