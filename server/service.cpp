#include "server/service.h"

#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "server/api/admin.h"
#include "server/base/idle_memory.h"
#include "server/base/log.h"
#include "server/base/machine.h"
#include "server/base/metrics.h"
#include "server/http/admin_server.h"
#include "server/http/event_streams.h"
#include "server/http/http_server.h"
#include "server/http/loop.h"
#include "server/jobs/janitor.h"
#include "server/sandbox/setup.h"

namespace kiln::server {
namespace {

// Every stream and connection is a descriptor; the usual soft limit of 1,024 is soon reached.
std::uint64_t raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return 1024;
  const rlim_t before = std::exchange(limit.rlim_cur, limit.rlim_max);
  return ::setrlimit(RLIMIT_NOFILE, &limit) == 0 ? limit.rlim_cur : before;
}

// The limits of the configuration, where a test has none of its own. Half of the descriptors stay
// for files, the store, and connections that are on their way out.
http::EdgeLimits edge_limits(http::EdgeLimits limits, const base::ServerConfig& config) {
  if (limits.connections == 0) limits.connections = config.max_connections;
  if (limits.connections_per_peer == 0)
    limits.connections_per_peer = config.max_connections_per_address;
  if (limits.uploads_per_peer == 0) limits.uploads_per_peer = config.max_uploads_per_address;
  if (limits.uploads_per_tenant == 0) limits.uploads_per_tenant = config.max_uploads_per_tenant;
  const std::uint64_t descriptors = raise_descriptor_limit();
  if (limits.connections <= descriptors / 2) return limits;
  log_line(base::LogLevel::kWarn, "descriptors",
           {{"limit", descriptors}, {"max_connections", descriptors / 2}});
  limits.connections = descriptors / 2;
  return limits;
}

unsigned bake_threads(const base::ServerConfig& config) {
  return config.threads ? config.threads : std::max(1u, std::thread::hardware_concurrency());
}

jobs::JobLimits job_limits(const base::ServerConfig& config,
                           std::shared_ptr<base::MemoryBudget> memory) {
  jobs::JobLimits limits;
  limits.memory = std::move(memory);
  limits.running = config.max_running_jobs;
  limits.queued = config.max_queued_jobs;
  limits.run = std::chrono::seconds(config.max_job_seconds);
  limits.ttl_seconds = config.job_ttl_seconds;
  limits.tenant_queued = config.max_queued_jobs_per_tenant;
  limits.tenant_running = config.max_running_jobs_per_tenant;
  limits.tenant_bytes = config.max_bytes_per_tenant;
  limits.tenant_texels = config.max_texels_per_tenant_per_day;
  limits.tenant_cpu_seconds = config.max_cpu_seconds_per_tenant_per_day;
  limits.checkpoint_share = config.checkpoint_percent / 100.0;
  limits.part_time = std::chrono::seconds(config.checkpoint_seconds);
  limits.memory_bytes = config.memory_budget_bytes;
  return limits;
}

// Returns what the configuration allows for an import, or what the machine has if that is less.
std::uint64_t import_memory(const base::ServerConfig& config, const base::MemoryBudget* memory) {
  const std::uint64_t most = memory ? memory->for_import() : 0;  // 0: no limit
  return most > 0 ? std::min(most, config.import_memory_bytes) : config.import_memory_bytes;
}

}  // namespace

struct Service::Impl {
  Impl(const base::ServerConfig& c, ServiceParts p, data::DataFolder folder)
      : config(c),
        parts(std::move(p)),
        data(std::move(folder)),
        store(data.database(), [this](double seconds) { metrics.committed(seconds); }),
        feeds(store, [this](const base::EventRing* ring) { streams.notify(ring); }),
        tokens(data.tokens()),
        gate(tokens),
        scenes(data),
        uploads(data, std::chrono::seconds(config.leftover_ttl_seconds)),
        streams(loop, std::chrono::seconds(config.heartbeat_seconds)),
        pool(bake_threads(config)),
        webhooks(store,
                 {webhooks::Networks::parse(config.webhook_networks).value(),
                  config.webhook_secrets, parts.webhook_limits, parts.webhook_delays},
                 [this](std::string_view outcome) { metrics.webhook(outcome); }),
        jobs({data, scenes, pool, parts.bake, sandbox::import_limits(config), &metrics}, store,
             job_limits(config, parts.memory)),
        janitor(data, store, scenes, uploads, jobs.control(),
                jobs::Retention{std::chrono::seconds(config.leftover_ttl_seconds),
                                config.max_data_bytes},
                parts.sweep_interval),
        api({config,
             data,
             store,
             scenes,
             jobs,
             feeds,
             webhooks,
             uploads,
             gate,
             {parts.check, parts.watch_checks},
             pool,
             parts.view,
             parts.see,
             metrics,
             import_memory(config, parts.memory.get())}),
        admin(api::admin_pages(
            data, store, [this] { return draining.load(); }, [this] { return metrics_text(); })) {
    idle_memory.emplace([this] { return jobs.admission().counts().running == 0; });
    jobs.notifier().on_event([this](const base::EventRing* ring) { streams.notify(ring); });
  }

  base::ServerConfig config;
  ServiceParts parts;
  data::DataFolder data;
  base::Metrics metrics;
  store::JobStore store;
  jobs::EventFeeds feeds;
  auth::TokenStore tokens;
  auth::Gate gate;
  data::SceneStore scenes;
  data::UploadStore uploads;
  http::Loop loop;
  http::EventStreams streams;
  exec::ThreadPool pool;
  // The listeners to events stand before the JobService: jobs that an earlier process left run
  // as soon as there is one.
  webhooks::Webhooks webhooks;
  jobs::JobService jobs;
  jobs::Janitor janitor;
  api::Api api;
  http::AdminPages admin;
  std::atomic<bool> draining{false};
  std::unique_ptr<http::HttpServer> api_server;
  std::unique_ptr<http::AdminServer> admin_server;
  std::optional<base::IdleMemory> idle_memory;  ///< asks the jobs

  std::string metrics_text() {
    const jobs::Admission::Counts jobs_now = jobs.admission().counts();
    return metrics.text({jobs_now.queued, jobs_now.running, streams.streams(), store.deliveries(),
                         api_server->waiting(), api_server->uploads(), streams.dropped(),
                         data.bytes(), data.free_share(), api_server->connections(),
                         config.memory_budget_bytes, jobs_now.reserved_bytes,
                         parts.memory ? parts.memory->spare() : 0});
  }

  proto::Expected<void> listen() {
    const http::EdgeLimits limits = edge_limits(parts.limits, config);
    const std::chrono::milliseconds slow(config.slow_request_ms);
    const auto count = [this](const http::Request& request, int status,
                              std::chrono::duration<double> time) {
      metrics.request(request.head.method, request.route, status, time.count());
    };
    auto main = http::HttpServer::start(
        {"api", config.listen, config.port, config.http_threads, limits, count, slow},
        [this](http::Request& request) { return api.handle(request); }, loop, streams);
    if (!main) return proto::Unexpected(main.error());
    api_server = std::move(*main);
    auto second = http::AdminServer::start(config.admin_listen, config.admin_port, admin);
    if (!second) return proto::Unexpected(second.error());
    admin_server = std::move(*second);
    return {};
  }
};

proto::Expected<std::unique_ptr<Service>> Service::start(const base::ServerConfig& given,
                                                         ServiceParts parts) {
  base::ServerConfig config = given;
  if (auto networks = webhooks::Networks::parse(config.webhook_networks); !networks)
    return proto::Unexpected(networks.error());
  if (!config.webhook_secrets.empty())
    if (auto secrets = webhooks::WebhookSecrets::read(config.webhook_secrets); !secrets)
      return proto::Unexpected(secrets.error());
  if (config.memory_budget_bytes == 0) config.memory_budget_bytes = base::usual_memory_budget();
  auto data = data::DataFolder::open(config.data);
  if (!data) return proto::Unexpected(data.error());
  std::unique_ptr<Impl> impl;
  try {
    impl = std::make_unique<Impl>(config, std::move(parts), std::move(*data));
  } catch (const store::DatabaseError& e) {
    return proto::fail(e.disk_full ? "storage_full" : "io_error", e.what());
  }
  if (!impl->tokens.required() && !auth::is_loopback(config.listen)) {
    impl->jobs.stop();
    return proto::fail("cannot_listen",
                       "There are no tokens, so anyone who reaches " + config.listen +
                           " could use the service. Create one first: lightkiln token create "
                           "--tenant NAME --data " +
                           config.data.string());
  }
  if (auto listening = impl->listen(); !listening) {
    impl->jobs.stop();
    return proto::Unexpected(listening.error());
  }
  return std::unique_ptr<Service>(new Service(std::move(impl)));
}

Service::Service(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Service::~Service() {
  stop(std::chrono::milliseconds(0));
}

std::uint16_t Service::port() const {
  return impl_->api_server->port();
}
std::uint16_t Service::admin_port() const {
  return impl_->admin_server->port();
}
jobs::JobService& Service::jobs() {
  return impl_->jobs;
}

auth::TokenStore& Service::tokens() {
  return impl_->tokens;
}
bool Service::needs_tokens() {
  return impl_->tokens.required();
}

void Service::begin_drain() {
  if (impl_->draining.exchange(true)) return;
  impl_->jobs.begin_drain();
  impl_->streams.announce_draining();
}

bool Service::wait_idle(std::chrono::milliseconds time) {
  return impl_->jobs.admission().wait_idle(time);
}

void Service::stop(std::chrono::milliseconds grace) {
  begin_drain();
  impl_->jobs.stop();
  impl_->webhooks.stop();
  impl_->api_server->stop(grace);
  impl_->streams.stop();
  impl_->admin_server->stop();
}

}  // namespace kiln::server
