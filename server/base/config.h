#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace kiln::base {

enum class LogFormat { kText, kJson };

/// Holds how the service runs. It is filled from flags, then LIGHTKILN_* variables, then a TOML
/// file, then these defaults; names, ranges and descriptions live in server/cli/config.cpp. Values
/// are in range.
struct ServerConfig {
  std::string listen = "127.0.0.1";        ///< address of the API; others than loopback need tokens
  std::string admin_listen = "127.0.0.1";  ///< address of the admin port, which asks for no token
  std::uint16_t port = 8080;               ///< API; 0: any free port, which the log names
  std::uint16_t admin_port = 8081;         ///< /healthz, /readyz; 0: any free port
  std::filesystem::path data =
      "lightkiln-data";                    ///< store, uploads and results; created if missing
  std::uint32_t threads = 0;               ///< threads of the bakes; 0: one per processor
  std::uint32_t http_threads = 16;         ///< threads of requests; streams and waits hold none
  std::uint32_t max_connections = 16'384;  ///< open at a time, event streams among them
  std::uint32_t max_connections_per_address = 4096;  ///< connections of one client or proxy
  std::uint32_t max_uploads_per_address = 256;       ///< bodies that arrive at a time; 0: no limit
  std::uint32_t max_uploads_per_tenant = 256;        ///< the same of one tenant; 0: no limit
  std::uint32_t slow_request_ms = 1000;         ///< more own time than this is logged; 0: never
  std::uint64_t max_upload_bytes = 1ull << 30;  ///< size of one request's body
  std::uint64_t max_request_json_bytes = 4ull << 20;  ///< size of one JSON body or `settings` part
  // A scene that asks for more than these (files::ImportLimits) is refused as `limit_exceeded`.
  std::uint64_t max_scene_triangles = 32'000'000;  ///< each use of a mesh counted
  std::uint32_t max_scene_nodes = 1'000'000;
  std::uint32_t max_scene_lights = 100'000;
  std::uint32_t max_scene_json_depth = 128;         ///< levels of nesting
  std::uint64_t max_image_pixels = 1ull << 28;      ///< pixels of one texture
  std::uint64_t max_all_image_pixels = 1ull << 29;  ///< pixels of all textures together
  std::uint64_t import_memory_bytes = 4ull << 30;   ///< memory of the process that reads a scene
  std::uint32_t max_import_processes = 4;           ///< at once; others wait
  std::uint32_t import_seconds = 300;               ///< time that this process may take
  std::uint32_t max_running_jobs = 2;
  /// The memory of running bakes and import processes together; 0: 4/5 of what is free at start.
  std::uint64_t memory_budget_bytes = 0;
  /// Memory of scenes that are kept ready for the next request of visibility; 0: none is kept.
  std::uint64_t visibility_cache_bytes = 512ull << 20;
  std::uint32_t max_queued_jobs = 1000;                  ///< beyond: `queue_full`
  std::uint32_t max_queued_jobs_per_tenant = 0;          ///< beyond: `quota_exceeded`; 0: no limit
  std::uint32_t max_running_jobs_per_tenant = 0;         ///< others wait; 0: no limit
  std::uint64_t max_texels_per_tenant_per_day = 0;       ///< baked; 0: no limit
  std::uint64_t max_cpu_seconds_per_tenant_per_day = 0;  ///< time of bakes; 0: no limit
  std::uint32_t max_requests_per_minute_per_tenant = 0;  ///< beyond: `rate_limited`; 0: no limit
  std::uint32_t max_requests_per_minute_per_token = 0;   ///< the same of one token
  std::uint64_t max_bytes_per_tenant = 0;                ///< size of results; 0: no limit
  std::uint32_t max_job_seconds = 0;      ///< longest attempt; beyond: `bake_timeout`; 0: no limit
  std::uint32_t checkpoint_percent = 5;   ///< share of the processors' time; 100: one for each pass
  std::uint32_t checkpoint_seconds = 10;  ///< time of one pass, after which its part so far is kept
  std::uint32_t job_ttl_seconds = 0;  ///< time that a job is kept, unless it sets one; 0: for ever
  std::uint32_t leftover_ttl_seconds = 86'400;  ///< unused scenes, checkpoints of failed jobs
  std::uint64_t max_data_bytes = 0;             ///< beyond, old jobs are deleted; 0: no limit
  std::uint32_t heartbeat_seconds = 15;         ///< time between comments on a silent event stream
  std::uint32_t drain_seconds = 30;             ///< time to finish for running jobs after SIGTERM
  std::filesystem::path webhook_secrets;        ///< file of NAME = SECRET lines; "": none
  std::string webhook_networks;                 ///< ranges that webhooks may reach besides public
  std::string log_level = "info";               ///< trace, debug, info, warn, error, off
  LogFormat log_format = LogFormat::kText;
};

}  // namespace kiln::base
