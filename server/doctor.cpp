#include "server/doctor.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/timex.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>
#include <thread>

#include "baker/bake.h"
#include "baker/image/image.h"
#include "proto/files.h"
#include "server/auth/gate.h"
#include "server/auth/token_store.h"
#include "server/base/clock.h"
#include "server/base/machine.h"
#include "server/data/data_folder.h"
#include "server/http/listen.h"

namespace kiln::server {
namespace {

namespace fs = std::filesystem;

constexpr double kGiB = double(1ull << 30);

template <class... Arguments>
std::string format(const char* pattern, Arguments... arguments) {
  std::array<char, 200> text{};
  std::snprintf(text.data(), text.size(), pattern, arguments...);
  return text.data();
}

Finding processor() {
  const std::string kernels = baker::instruction_set();
  Finding f{
      "processor", Health::kOk,
      std::to_string(std::thread::hardware_concurrency()) + " threads, kernels for " + kernels, ""};
  if (kernels != "sse2") return f;
  f.health = Health::kWarn;
  f.advice =
      "The processor, or the virtual machine's model of it, has no AVX2: bakes take about twice as "
      "long. Let the machine pass the host's processor through.";
  return f;
}

Finding memory(const base::ServerConfig& config) {
  const std::uint64_t free = base::free_memory_bytes();
  const std::uint64_t budget =
      config.memory_budget_bytes ? config.memory_budget_bytes : free / 5 * 4;
  Finding f{
      "memory", Health::kOk,
      format("%.1f GiB free, bakes may take %.1f GiB", double(free) / kGiB, double(budget) / kGiB),
      ""};
  if (budget > free) {
    f.health = Health::kWarn;
    f.advice = "--memory-budget-bytes is more than there is: bakes would swap, or be killed.";
  } else if (double(budget) < 0.5 * kGiB) {
    f.health = Health::kWarn;
    f.advice = "Large scenes will be refused as job_too_large: give the machine or container more.";
  }
  return f;
}

// Measures how long a small file takes to the disk, as every accepted job does: the median of some.
double fsync_seconds(const fs::path& path) {
  const proto::Fd fd(::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600));
  if (!fd.valid()) return -1;
  std::array<double, 9> times{};
  const std::string page(4096, 'x');
  bool ok = true;
  for (double& time : times) {
    const auto began = std::chrono::steady_clock::now();
    ok = ok && ::write(fd.get(), page.data(), page.size()) == ssize_t(page.size()) &&
         ::fsync(fd.get()) == 0;
    time = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  }
  ::unlink(path.c_str());
  std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
  return ok ? times[times.size() / 2] : -1;
}

Finding data_fsync(const fs::path& data) {
  std::error_code error;
  fs::create_directories(data, error);
  const double seconds = fsync_seconds(data / (".doctor-" + std::to_string(::getpid())));
  if (seconds < 0)
    return {"data_fsync", Health::kFail, data.string() + " can't be written",
            "Give the service's user the folder, or another with --data; and look whether the disk "
            "is full or read-only."};
  Finding f{"data_fsync", Health::kOk, format("%.2f ms in ", seconds * 1000) + data.string(), ""};
  if (seconds > 0.05) {
    f.health = Health::kWarn;
    f.advice =
        "Each accepted job waits for the disk: use one with a write cache, or not a network "
        "file system.";
  } else if (seconds < 2e-5) {
    f.value += ", which no disk can do: it is memory, or it does not flush";
    f.health = Health::kWarn;
    f.advice = "Jobs would not survive a power failure there; give --data a disk.";
  }
  return f;
}

Finding disk_free(const fs::path& data) {
  std::error_code error;
  const auto space = fs::space(data, error);
  if (error || space.capacity == 0)
    return {"disk_free", Health::kFail, "unknown: " + error.message(), "See data_fsync."};
  const double share = double(space.available) / double(space.capacity);
  Finding f{"disk_free", Health::kOk,
            format("%.1f GiB, %.0f %%", double(space.available) / kGiB, share * 100), ""};
  if (share < 0.05) {
    f.health = Health::kFail;
    f.advice = "Below 5 % /readyz answers 503. Free some, or set --max-data-bytes.";
  } else if (share < 0.15) {
    f.health = Health::kWarn;
    f.advice = "Set --max-data-bytes, so that old jobs go before the disk is full.";
  }
  return f;
}

Finding descriptors(const base::ServerConfig& config) {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  Finding f{"descriptors", Health::kOk, std::to_string(limit.rlim_max) + " at most", ""};
  if (limit.rlim_max >= 2ull * config.max_connections) return f;
  f.health = Health::kWarn;
  f.advice = "Only " + std::to_string(limit.rlim_max / 2) + " of the " +
             std::to_string(config.max_connections) +
             " connections of --max-connections can be open: raise LimitNOFILE (systemd), "
             "--ulimit nofile (docker) or `ulimit -Hn`.";
  return f;
}

Finding port(const char* name, const std::string& address, std::uint16_t number) {
  Finding f{name, Health::kOk, address + ":" + std::to_string(number), ""};
  if (http::listen_on(address, number).valid()) return f;
  f.health = Health::kFail;
  f.value += " can't be listened on";
  f.advice =
      "Another program has it (`ss -ltnp` tells which; perhaps the service runs), the address "
      "is not this machine's, or a port below 1024 needs a privilege.";
  return f;
}

Finding tokens(const base::ServerConfig& config) {
  const fs::path path = data::DataFolder::tokens_of(config.data);
  std::error_code error;
  const bool required = fs::exists(path, error) && auth::TokenStore(path).required();
  Finding f{"tokens", Health::kOk, required ? "required" : "none: loopback only", ""};
  if (required || auth::is_loopback(config.listen)) return f;
  f.health = Health::kFail;
  f.advice = "On " + config.listen +
             " the service starts with a token only: lightkiln token create --tenant NAME --data " +
             config.data.string();
  return f;
}

Finding wall_clock() {
  constexpr std::time_t kPlausible = 1'704'067'200;  // 2024-01-01
  timex state{};
  const int kind = ::adjtimex(&state);
  const std::time_t now = std::time(nullptr);
  Finding f{"clock", Health::kOk, base::now_rfc3339(), ""};
  if (now < kPlausible) {
    f.health = Health::kFail;
    f.advice = "The clock is wrong: times to live and tokens that expire depend on it.";
  } else if (kind == TIME_ERROR || (state.status & STA_UNSYNC) != 0) {
    f.health = Health::kWarn;
    f.value += ", not synchronized";
    f.advice =
        "Run chrony or systemd-timesyncd: times to live and webhook signatures use the clock.";
  }
  return f;
}

Finding sqlite() {
  constexpr int kReturning = 3'035'000;  // the first with RETURNING, which the store uses
  Finding f{"sqlite", Health::kOk, sqlite3_libversion(), ""};
  if (sqlite3_libversion_number() >= kReturning && sqlite3_threadsafe() != 0) return f;
  f.health = Health::kFail;
  f.advice = "The job store needs SQLite 3.35 or later, built for threads.";
  return f;
}

Finding image_module() {
  const auto opened = image::open_module();
  if (opened) return {"image_module", Health::kOk, "OpenImageIO can be used", ""};
  return {
      "image_module", Health::kFail, opened.error().message,
      "Scenes with textures and all bakes fail. Install the program anew, with the packages that "
      "docker/Dockerfile lists."};
}

}  // namespace

std::vector<Finding> examine(const base::ServerConfig& config) {
  return {processor(),
          memory(config),
          image_module(),
          data_fsync(config.data),
          disk_free(config.data),
          descriptors(config),
          port("port", config.listen, config.port),
          port("admin_port", config.admin_listen, config.admin_port),
          tokens(config),
          wall_clock(),
          sqlite()};
}

Health worst(const std::vector<Finding>& findings) {
  Health worst = Health::kOk;
  for (const auto& f : findings) worst = std::max(worst, f.health);
  return worst;
}

const char* to_string(Health health) {
  constexpr std::array<const char*, 3> kNames{"ok", "warn", "fail"};
  return kNames.at(static_cast<std::size_t>(health));
}

nlohmann::json to_json(const std::vector<Finding>& findings) {
  auto checks = nlohmann::json::array();
  for (const auto& f : findings)
    checks.push_back({{"name", f.name},
                      {"health", to_string(f.health)},
                      {"value", f.value},
                      {"advice", f.advice}});
  return {{"version", LIGHTKILN_VERSION},
          {"health", to_string(worst(findings))},
          {"checks", std::move(checks)}};
}

}  // namespace kiln::server
