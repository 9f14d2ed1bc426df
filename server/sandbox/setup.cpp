#include "server/sandbox/setup.h"

#include <atomic>
#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"
#include "server/base/log.h"

namespace kiln::sandbox {

files::ImportLimits import_limits(const base::ServerConfig& config) {
  files::ImportLimits limits;
  limits.file_bytes = config.max_upload_bytes;
  limits.json_depth = config.max_scene_json_depth;
  limits.nodes = config.max_scene_nodes;
  limits.triangles = config.max_scene_triangles;
  limits.vertices = 3 * config.max_scene_triangles;  // more are of no use to triangles
  limits.image_pixels = config.max_image_pixels;
  limits.all_image_pixels = config.max_all_image_pixels;
  limits.lights = config.max_scene_lights;
  return limits;
}

std::shared_ptr<Zygote> start_zygote() {
  return std::make_shared<Zygote>(Zygote::Options{.failed = [](const std::string& reason) {
    base::log_line(base::LogLevel::kWarn, "import.zygote_ended", {{"reason", reason}});
  }});
}

proto::Expected<std::shared_ptr<const Importer>> make_importer(
    const base::ServerConfig& config, std::shared_ptr<base::MemoryBudget> memory,
    std::shared_ptr<Zygote> zygote) {
  Importer::Options options;
  options.limits = import_limits(config);
  options.process.memory_bytes = config.import_memory_bytes;
  options.memory = std::move(memory);
  options.process.seconds = config.import_seconds;
  options.process.started = [](pid_t pid) {
    log_line(base::LogLevel::kDebug, "import.process", {{"pid", pid}});
  };
  options.process.failed = [](const std::string& reason, const std::string& said) {
    log_line(base::LogLevel::kWarn, "import.failed", {{"reason", reason}, {"stderr", said}});
  };
  // tmp/ is on the same disk as the scenes, and emptied at every start.
  options.new_temporary = [folder = config.data / "tmp",
                           next = std::make_shared<std::atomic<std::uint64_t>>(0)] {
    return folder / ("import-" + std::to_string(++*next));
  };
  options.process.zygote = std::move(zygote);
  auto importer = std::make_shared<const Importer>(std::move(options));
  const auto confined = importer->probe();
  if (!confined) return proto::Unexpected(confined.error());
  const bool whole = confined->no_seccomp.empty() && confined->memory;
  log_line(whole ? base::LogLevel::kInfo : base::LogLevel::kWarn, "import.confined",
           {{"seccomp", confined->no_seccomp.empty() ? "on" : "off: " + confined->no_seccomp},
            {"memory_limit", confined->memory ? "on" : "off"}});
  return importer;
}

}  // namespace kiln::sandbox
