#include "server/cli/config.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>

#include "proto/nearest_name.h"
#include "proto/problem_list.h"
#include "server/cli/toml_values.h"
#include "server/webhooks/networks.h"

extern char** environ;

namespace kiln::cli {
namespace {

using base::LogFormat;
using base::ServerConfig;

constexpr std::string_view kPrefix = "LIGHTKILN_";

/// These variables belong to other commands or to the loader itself.
constexpr std::array<std::string_view, 3> kOtherVariables{"LIGHTKILN_CONFIG", "LIGHTKILN_SERVER",
                                                          "LIGHTKILN_TOKEN"};

std::optional<std::uint64_t> whole_number(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return {};
  return value;
}

std::optional<std::uint64_t> byte_count(std::string_view text) {
  constexpr std::array<std::pair<std::string_view, unsigned>, 3> kUnits{
      {{"KiB", 10}, {"MiB", 20}, {"GiB", 30}}};
  unsigned shift = 0;
  for (const auto& [unit, bits] : kUnits) {
    if (text.size() <= unit.size() || text.substr(text.size() - unit.size()) != unit) continue;
    text.remove_suffix(unit.size());
    shift = bits;
  }
  const auto value = whole_number(text);
  if (!value || *value > (~std::uint64_t{0} >> shift)) return {};
  return *value << shift;
}

template <auto Member, std::uint64_t Min, std::uint64_t Max>
bool parse_number(ServerConfig& config, const std::string& text) {
  const auto value = whole_number(text);
  if (!value || *value < Min || *value > Max) return false;
  config.*Member = static_cast<std::remove_reference_t<decltype(config.*Member)>>(*value);
  return true;
}

template <auto Member, std::uint64_t Min>
bool parse_bytes(ServerConfig& config, const std::string& text) {
  const auto value = byte_count(text);
  if (!value || *value < Min || *value > (1ull << 62)) return false;
  config.*Member = *value;
  return true;
}

template <auto Member>
std::string show_number(const ServerConfig& config) {
  return std::to_string(config.*Member);
}

template <auto Member>
bool parse_address(ServerConfig& config, const std::string& text) {
  const bool fits = !text.empty() && text.size() <= 255 &&
                    std::all_of(text.begin(), text.end(), [](unsigned char c) {
                      return std::isalnum(c) != 0 || c == '.' || c == ':' || c == '-' || c == '_';
                    });
  if (fits) config.*Member = text;
  return fits;
}

bool parse_folder(ServerConfig& config, const std::string& text) {
  if (text.empty() || text.find('\0') != std::string::npos) return false;
  config.data = text;
  return true;
}

bool parse_secrets(ServerConfig& config, const std::string& text) {
  if (text.find('\0') != std::string::npos) return false;
  config.webhook_secrets = text;
  return true;
}

bool parse_networks(ServerConfig& config, const std::string& text) {
  if (!webhooks::Networks::parse(text)) return false;
  config.webhook_networks = text;
  return true;
}

bool parse_log_level(ServerConfig& config, const std::string& text) {
  constexpr std::array<std::string_view, 6> kLevels{"trace", "debug", "info",
                                                    "warn",  "error", "off"};
  if (std::find(kLevels.begin(), kLevels.end(), text) == kLevels.end()) return false;
  config.log_level = text;
  return true;
}

bool parse_log_format(ServerConfig& config, const std::string& text) {
  if (text != "text" && text != "json") return false;
  config.log_format = text == "json" ? LogFormat::kJson : LogFormat::kText;
  return true;
}

}  // namespace

// clang-format off
const std::vector<ConfigRow>& config_rows() {
  using C = ServerConfig;
  static const std::vector<ConfigRow> rows{
      {"listen", false, "an address or host name",
       "Address of the API; another than loopback needs tokens (lightkiln token)",
       parse_address<&C::listen>, [](const C& c) { return c.listen; }},
      {"admin_listen", false, "an address or host name",
       "Address of the admin port, which asks for no token",
       parse_address<&C::admin_listen>, [](const C& c) { return c.admin_listen; }},
      {"port", true, "a port from 0 to 65535", "Port of the API; 0: any free one",
       parse_number<&C::port, 0, 65535>, show_number<&C::port>},
      {"admin_port", true, "a port from 0 to 65535", "Port of /healthz and /readyz; 0: any free one",
       parse_number<&C::admin_port, 0, 65535>, show_number<&C::admin_port>},
      {"data", false, "a folder", "Folder of jobs, uploads and results; created when missing",
       parse_folder, [](const C& c) { return c.data.string(); }},
      {"threads", true, "a number from 0 to 1024", "Threads that bake; 0: one per processor",
       parse_number<&C::threads, 0, 1024>, show_number<&C::threads>},
      {"http_threads", true, "a number from 2 to 1024", "Threads that answer requests",
       parse_number<&C::http_threads, 2, 1024>, show_number<&C::http_threads>},
      {"max_connections", true, "a number from 16 to 1000000",
       "Connections that may be open at a time, event streams included; at most half of the\n"
       "descriptors that the process may have; one more is refused with overloaded",
       parse_number<&C::max_connections, 16, 1'000'000>, show_number<&C::max_connections>},
      {"max_connections_per_address", true, "a number from 0 to 1000000",
       "Connections from one address, perhaps a proxy's, that may be open; one more is refused with\n"
       "too_many_connections; 0: no separate limit",
       parse_number<&C::max_connections_per_address, 0, 1'000'000>,
       show_number<&C::max_connections_per_address>},
      {"max_uploads_per_address", true, "a number from 0 to 1000000",
       "Request bodies that may be arriving at a time from one address; one more is refused with\n"
       "too_many_uploads; 0: no limit",
       parse_number<&C::max_uploads_per_address, 0, 1'000'000>,
       show_number<&C::max_uploads_per_address>},
      {"max_uploads_per_tenant", true, "a number from 0 to 1000000",
       "The same of one tenant; without tokens all clients are one",
       parse_number<&C::max_uploads_per_tenant, 0, 1'000'000>,
       show_number<&C::max_uploads_per_tenant>},
      {"slow_request_ms", true, "a number from 0 to 3600000",
       "Milliseconds of work from which on the log warns of a request (request.slow), not counting\n"
       "the time that its client takes; 0: never",
       parse_number<&C::slow_request_ms, 0, 3'600'000>, show_number<&C::slow_request_ms>},
      {"max_upload_bytes", false, "a number of bytes from 1KiB on, such as 536870912 or 512MiB",
       "Largest body of a request", parse_bytes<&C::max_upload_bytes, 1024>,
       show_number<&C::max_upload_bytes>},
      {"max_request_json_bytes", false, "a number of bytes from 1KiB on, such as 4194304 or 4MiB",
       "Largest JSON body or settings part", parse_bytes<&C::max_request_json_bytes, 1024>,
       show_number<&C::max_request_json_bytes>},
      {"max_scene_triangles", true, "a number from 1 to 1000000000",
       "Triangles of a scene, counting each use of a mesh; more are refused with limit_exceeded",
       parse_number<&C::max_scene_triangles, 1, 1'000'000'000>,
       show_number<&C::max_scene_triangles>},
      {"max_scene_nodes", true, "a number from 1 to 10000000", "Nodes of a scene",
       parse_number<&C::max_scene_nodes, 1, 10'000'000>, show_number<&C::max_scene_nodes>},
      {"max_scene_lights", true, "a number from 0 to 10000000", "Lights of a scene",
       parse_number<&C::max_scene_lights, 0, 10'000'000>, show_number<&C::max_scene_lights>},
      {"max_scene_json_depth", true, "a number from 8 to 1000",
       "Levels of nesting in the JSON of a scene",
       parse_number<&C::max_scene_json_depth, 8, 1000>, show_number<&C::max_scene_json_depth>},
      {"max_image_pixels", true, "a number from 1 to 4294967296", "Pixels of one texture",
       parse_number<&C::max_image_pixels, 1, (1ull << 32)>, show_number<&C::max_image_pixels>},
      {"max_all_image_pixels", true, "a number from 1 to 17179869184",
       "Pixels of all textures of a scene together",
       parse_number<&C::max_all_image_pixels, 1, (1ull << 34)>,
       show_number<&C::max_all_image_pixels>},
      {"import_memory_bytes", false, "a number of bytes from 64MiB on, such as 4GiB",
       "Memory of the process that reads a scene; beyond, the job fails with import_out_of_memory",
       parse_bytes<&C::import_memory_bytes, (64ull << 20)>, show_number<&C::import_memory_bytes>},
      {"max_import_processes", true, "a number from 1 to 256",
       "Processes that read scenes at the same time; others wait",
       parse_number<&C::max_import_processes, 1, 256>, show_number<&C::max_import_processes>},
      {"import_seconds", true, "a number from 1 to 86400",
       "Seconds that reading a scene may take; beyond, the job fails with import_timeout",
       parse_number<&C::import_seconds, 1, 86400>, show_number<&C::import_seconds>},
      {"max_running_jobs", true, "a number from 1 to 256", "Jobs that bake at the same time",
       parse_number<&C::max_running_jobs, 1, 256>, show_number<&C::max_running_jobs>},
      {"memory_budget_bytes", false, "0 or a number of bytes, such as 24GiB",
       "Memory that running bakes, by their estimates, and import processes may take; others wait;\n"
       "0: four fifths of what the machine or container has free at the start",
       parse_bytes<&C::memory_budget_bytes, 0>, show_number<&C::memory_budget_bytes>},
      {"visibility_cache_bytes", false, "0 or a number of bytes, such as 512MiB",
       "Memory of scenes that are kept ready for the next POST /v1/visibility, the last used ones; it\n"
       "counts in the memory budget, and is given to whatever needs it; 0: none is kept",
       parse_bytes<&C::visibility_cache_bytes, 0>, show_number<&C::visibility_cache_bytes>},
      {"max_queued_jobs", true, "a number from 1 to 1000000",
       "Jobs that may wait; one more is refused with queue_full",
       parse_number<&C::max_queued_jobs, 1, 1'000'000>, show_number<&C::max_queued_jobs>},
      {"max_job_seconds", true, "a number from 0 to 31536000",
       "Seconds that one attempt at a job may take before it fails with bake_timeout; 0: no limit",
       parse_number<&C::max_job_seconds, 0, 31'536'000>, show_number<&C::max_job_seconds>},
      {"checkpoint_percent", true, "a number from 1 to 100",
       "Percent of the processors' time that a bake's checkpoints may take; short passes share a\n"
       "checkpoint; 100: each pass waits for one of its own",
       parse_number<&C::checkpoint_percent, 1, 100>, show_number<&C::checkpoint_percent>},
      {"checkpoint_seconds", true, "a number from 1 to 86400",
       "Seconds of a pass after which its results so far go into a checkpoint",
       parse_number<&C::checkpoint_seconds, 1, 86400>, show_number<&C::checkpoint_seconds>},
      {"max_queued_jobs_per_tenant", true, "a number from 0 to 1000000",
       "Jobs of one tenant that may wait; 0: no separate limit",
       parse_number<&C::max_queued_jobs_per_tenant, 0, 1'000'000>,
       show_number<&C::max_queued_jobs_per_tenant>},
      {"max_running_jobs_per_tenant", true, "a number from 0 to 256",
       "Jobs of one tenant that may bake at the same time; 0: no separate limit",
       parse_number<&C::max_running_jobs_per_tenant, 0, 256>,
       show_number<&C::max_running_jobs_per_tenant>},
      {"max_bytes_per_tenant", false, "0 or a number of bytes, such as 20GiB",
       "Bytes of one tenant's results, beyond which new jobs are refused; 0: no limit",
       parse_bytes<&C::max_bytes_per_tenant, 0>, show_number<&C::max_bytes_per_tenant>},
      {"max_texels_per_tenant_per_day", true, "a number from 0 to 10^15",
       "Texels that the jobs of one tenant may bake in a day of UTC; 0: no limit",
       parse_number<&C::max_texels_per_tenant_per_day, 0, 1'000'000'000'000'000>,
       show_number<&C::max_texels_per_tenant_per_day>},
      {"max_cpu_seconds_per_tenant_per_day", true, "a number from 0 to 10^12",
       "Processor seconds that the jobs of one tenant may take in a day of UTC; 0: no limit",
       parse_number<&C::max_cpu_seconds_per_tenant_per_day, 0, 1'000'000'000'000>,
       show_number<&C::max_cpu_seconds_per_tenant_per_day>},
      {"max_requests_per_minute_per_tenant", true, "a number from 0 to 1000000",
       "Requests of one tenant in a minute; one more is refused with rate_limited; 0: no limit",
       parse_number<&C::max_requests_per_minute_per_tenant, 0, 1'000'000>,
       show_number<&C::max_requests_per_minute_per_tenant>},
      {"max_requests_per_minute_per_token", true, "a number from 0 to 1000000",
       "Requests of one token in a minute; one more is refused with rate_limited; 0: no limit",
       parse_number<&C::max_requests_per_minute_per_token, 0, 1'000'000>,
       show_number<&C::max_requests_per_minute_per_token>},
      {"job_ttl_seconds", true, "a number from 0 to 315360000",
       "Seconds that a job and its files are kept after it ends, unless it sets its own; 0: forever",
       parse_number<&C::job_ttl_seconds, 0, 315'360'000>, show_number<&C::job_ttl_seconds>},
      {"leftover_ttl_seconds", true, "a number from 1 to 315360000",
       "Seconds that checkpoints of failed jobs, and scenes that no job uses, are kept",
       parse_number<&C::leftover_ttl_seconds, 1, 315'360'000>,
       show_number<&C::leftover_ttl_seconds>},
      {"max_data_bytes", false, "0 or a number of bytes, such as 500GiB",
       "Bytes of the data folder, beyond which finished jobs are deleted, oldest first; 0: no limit",
       parse_bytes<&C::max_data_bytes, 0>, show_number<&C::max_data_bytes>},
      {"heartbeat_seconds", true, "a number from 1 to 3600",
       "Seconds between comments on a silent event stream",
       parse_number<&C::heartbeat_seconds, 1, 3600>, show_number<&C::heartbeat_seconds>},
      {"drain_seconds", true, "a number from 0 to 86400",
       "Seconds that running jobs get to finish after SIGTERM",
       parse_number<&C::drain_seconds, 0, 86400>, show_number<&C::drain_seconds>},
      {"webhook_secrets", false, "a file",
       "File of lines NAME = whsec_... or TENANT/NAME = whsec_... that webhooks name to be signed",
       parse_secrets, [](const C& c) { return c.webhook_secrets.string(); }},
      {"webhook_networks", false, "address ranges such as 10.0.0.0/8, fd00::/8",
       "Addresses that webhooks may reach besides public ones",
       parse_networks, [](const C& c) { return c.webhook_networks; }},
      {"log_level", false, "trace, debug, info, warn, error or off", "Least important line to log",
       parse_log_level, [](const C& c) { return c.log_level; }},
      {"log_format", false, "text or json", "Form of the log's lines: text for people, json for programs",
       parse_log_format,
       [](const C& c) { return std::string(c.log_format == LogFormat::kJson ? "json" : "text"); }},
  };
  return rows;
}
// clang-format on

std::string flag_of(std::string_view name) {
  std::string flag = "--" + std::string(name);
  std::replace(flag.begin(), flag.end(), '_', '-');
  return flag;
}

std::string variable_of(std::string_view name) {
  std::string variable(kPrefix);
  for (const char c : name)
    variable += static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return variable;
}

Environment process_environment() {
  Environment out;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string_view text(*entry);
    if (const auto equals = text.find('='); equals != std::string_view::npos)
      out.emplace(text.substr(0, equals), text.substr(equals + 1));
  }
  return out;
}

std::filesystem::path default_data_folder(const Environment& environment) {
  const auto folder = [&](const char* name) {
    const auto at = environment.find(name);
    const std::filesystem::path path(at == environment.end() ? "" : at->second);
    return path.is_absolute() ? path : std::filesystem::path();
  };
  if (const auto xdg = folder("XDG_DATA_HOME"); !xdg.empty()) return xdg / "lightkiln";
  if (const auto home = folder("HOME"); !home.empty()) return home / ".local/share/lightkiln";
  return "lightkiln-data";
}

namespace {

/// Applies the sources over one another and collects what is wrong with them.
class Loader {
 public:
  explicit Loader(const ConfigSources& sources) : sources_(sources) {
    out_.config.data = default_data_folder(sources.environment);
    for (const auto& row : config_rows()) out_.origin[std::string(row.name)] = "default";
  }

  proto::Expected<LoadedConfig> run() {
    if (auto ok = read_file(); !ok) return proto::Unexpected(std::move(ok.error()));
    read_environment();
    for (const auto& [name, text] : sources_.flags) set(name, text, "flag", flag_of(name));
    check_together();
    if (!problems_.empty()) return proto::Unexpected(std::move(problems_).error("invalid_config"));
    return std::move(out_);
  }

 private:
  const ConfigSources& sources_;
  LoadedConfig out_;
  proto::ProblemList problems_{"config"};

  static const ConfigRow* row_of(std::string_view name) {
    const auto& rows = config_rows();
    const auto at =
        std::find_if(rows.begin(), rows.end(), [&](const ConfigRow& r) { return r.name == name; });
    return at == rows.end() ? nullptr : &*at;
  }

  void set(const std::string& name, const std::string& text, const std::string& origin,
           const std::string& place) {
    const ConfigRow* row = row_of(name);
    if (row != nullptr && row->parse(out_.config, text)) {
      out_.origin[name] = origin;
      return;
    }
    if (row == nullptr)
      problems_.add(place, "unknown");
    else
      problems_.add(place, "expected " + std::string(row->expected) + ", found \"" + text + "\"");
  }

  void read_environment() {
    std::vector<std::string> variables(kOtherVariables.begin(), kOtherVariables.end());
    for (const auto& row : config_rows()) variables.push_back(variable_of(row.name));
    const std::vector<std::string_view> known(variables.begin(), variables.end());
    for (const auto& [variable, text] : sources_.environment) {
      if (variable.rfind(kPrefix, 0) != 0) continue;
      if (std::find(known.begin(), known.end(), variable) == known.end())
        problems_.add(variable, "unknown variable" + proto::name_hint(variable, known));
      for (const auto& row : config_rows())
        if (variable == variable_of(row.name)) set(std::string(row.name), text, variable, variable);
    }
  }

  proto::Expected<void> read_file() {
    std::error_code error;
    const auto& path = sources_.file.value_or(sources_.default_file);
    if (!sources_.file && !std::filesystem::exists(path, error)) return {};
    auto values = read_toml(path);
    if (!values) return proto::Unexpected(std::move(values.error()));
    std::vector<std::string_view> known;
    for (const auto& row : config_rows()) known.push_back(row.name);
    for (const auto& [key, value] : *values) {
      const ConfigRow* row = row_of(key);
      const std::string place = path.string() + ": " + key;
      if (row == nullptr)
        problems_.add(place, "unknown key" + proto::name_hint(key, known));
      else if (row->is_number && value.kind != TomlValue::Kind::kInteger)
        problems_.add(place, "expected " + std::string(row->expected) + ", as a bare number");
      else if (value.kind == TomlValue::Kind::kOther)
        problems_.add(place, "expected " + std::string(row->expected));
      else
        set(key, value.text, path.string(), place);
    }
    return {};
  }

  void check_together() {
    const auto& c = out_.config;
    if (c.port != 0 && c.port == c.admin_port)
      problems_.add(flag_of("admin_port"),
                    "expected another port than --port (" + std::to_string(c.port) + ")");
  }
};

}  // namespace

proto::Expected<LoadedConfig> load_config(const ConfigSources& sources) {
  return Loader(sources).run();
}

std::string config_text(const LoadedConfig& loaded) {
  std::string out;
  for (const auto& row : config_rows()) {
    const std::string value = row.show(loaded.config);
    const bool bare = !value.empty() && whole_number(value) && row.name != "listen" &&
                      row.name != "admin_listen" && row.name != "data";
    // Long descriptions have line breaks for the help. Here each of their lines must be a comment.
    std::string description(row.description);
    for (auto at = description.find('\n'); at != std::string::npos;
         at = description.find('\n', at + 3))
      description.replace(at, 1, "\n# ");
    out += "# " + description + " (from: " + loaded.origin.at(std::string(row.name)) + ")\n" +
           std::string(row.name) + " = " + (bare ? value : toml_string(value)) + "\n";
  }
  return out;
}

}  // namespace kiln::cli
