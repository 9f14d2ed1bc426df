#include "server/serve.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <thread>

#include "baker/bake.h"
#include "server/base/log.h"
#include "server/base/machine.h"
#include "server/sandbox/image_process.h"
#include "server/sandbox/setup.h"
#include "server/service.h"
#include "server/view.h"
#include "server/visibility.h"

namespace kiln::server {
namespace {

using std::chrono::milliseconds;

sigset_t stop_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  return set;
}

// Waits for a stop signal, for at most `time`. Threads inherit the mask, so none is interrupted.
bool signal_within(milliseconds time) {
  const sigset_t set = stop_signals();
  // Being stopped and continued, by a debugger or a job control signal, interrupts the wait.
  const auto deadline = std::chrono::steady_clock::now() + time;
  for (;;) {
    const auto left = std::max(milliseconds(0), std::chrono::duration_cast<milliseconds>(
                                                    deadline - std::chrono::steady_clock::now()));
    const timespec wait{static_cast<time_t>(left.count() / 1000),
                        static_cast<long>(left.count() % 1000) * 1'000'000};
    if (::sigtimedwait(&set, nullptr, &wait) > 0) return true;
    if (errno != EINTR) return false;
  }
}

void announce(const base::ServerConfig& config, Service& service) {
  const auto url = [&](const std::string& address, std::uint16_t port) {
    const bool v6 = address.find(':') != std::string::npos;
    return "http://" + (v6 ? "[" + address + "]" : address) + ":" + std::to_string(port);
  };
  log_line(base::LogLevel::kInfo, "ready",
           {{"api", url(config.listen, service.port())},
            {"admin", url(config.admin_listen, service.admin_port())},
            {"tokens", service.needs_tokens() ? "required" : "none: loopback only"},
            {"data", std::filesystem::absolute(config.data).string()},
            {"version", LIGHTKILN_VERSION}});
}

// Running jobs get their time; a second signal takes it away. Returns whether that happened.
bool wait_for_jobs(Service& service, std::uint32_t seconds) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
  while (!service.wait_idle(milliseconds(0)) && std::chrono::steady_clock::now() < deadline)
    if (signal_within(milliseconds(100))) return true;
  return false;
}

// The last resort: a bake that does not stop must not keep the process, and a second signal is
// obeyed. What was promised is on the disk already; the job is run again at the next start.
[[noreturn]] void give_up_after(milliseconds time) {
  if (signal_within(time)) std::this_thread::sleep_for(milliseconds(1'000));
  std::fputs("lightkiln: stopped by force\n", stderr);
  std::_Exit(2);
}

// Makes the baker, with everything that decodes an upload in another process. What an import makes
// is kept beside the upload, and goes with it.
ServiceParts isolated_parts(const std::shared_ptr<const sandbox::Importer>& importer,
                            std::shared_ptr<base::MemoryBudget> memory,
                            const base::ServerConfig& config) {
  ServiceParts parts;
  parts.view = make_view(importer, memory);
  parts.see = make_visibility(importer, memory, config.visibility_cache_bytes);
  parts.watch_checks = [memory](std::function<void()> wake) {
    return memory->watch(std::move(wake));
  };
  parts.memory = std::move(memory);
  parts.bake = [importer](jobs::JobInput input, exec::ThreadPool& pool, std::stop_token stop,
                          baker::BakeObserver& observer) {
    input.files.sky_map = input.settings.sky.map;
    input.source =
        importer->open(input.files, input.scene_key, input.files.main.parent_path(), input.job);
    return baker::bake(input, pool, std::move(stop), observer);
  };
  parts.check = [importer](const files::SceneFiles& files, const proto::BakeSettings& settings) {
    return importer->check(files, settings);
  };
  return parts;
}

}  // namespace

int serve(const base::ServerConfig& given) {
  base::ServerConfig config = given;
  const sigset_t set = stop_signals();
  ::pthread_sigmask(SIG_BLOCK, &set, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  set_up_log(config.log_level, config.log_format);

  if (config.memory_budget_bytes == 0) config.memory_budget_bytes = base::usual_memory_budget();
  const auto memory = std::make_shared<base::MemoryBudget>(
      config.memory_budget_bytes,
      base::MemoryBudget::Imports{.processes = config.max_import_processes,
                                  .most_bytes = config.import_memory_bytes,
                                  .impatient = std::max(config.http_threads / 4, 1u)});
  const auto zygote = sandbox::start_zygote();
  const sandbox::ImageProcesses images({.zygote = zygote});
  const auto importer = sandbox::make_importer(config, memory, zygote);
  if (!importer) {
    std::fprintf(stderr, "lightkiln: %s\n", importer.error().message.c_str());
    return 1;
  }
  auto service = Service::start(config, isolated_parts(*importer, memory, config));
  if (!service) {
    std::fprintf(stderr, "lightkiln: %s\n", service.error().message.c_str());
    return 1;
  }
  announce(config, **service);
  while (!signal_within(milliseconds(3'600'000))) {
  }

  log_line(base::LogLevel::kInfo, "draining", {{"seconds", config.drain_seconds}});
  (*service)->begin_drain();
  const bool forced = wait_for_jobs(**service, config.drain_seconds);
  constexpr milliseconds kGrace{10'000}, kPatience{20'000};
  std::thread([forced, kPatience] {
    give_up_after(forced ? milliseconds(3'000) : kPatience);
  }).detach();
  (*service)->stop(forced ? milliseconds(0) : kGrace);
  service->reset();
  log_line(base::LogLevel::kInfo, "stopped", {{"forced", forced}});
  return forced ? 2 : 0;
}

}  // namespace kiln::server
