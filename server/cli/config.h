#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"
#include "server/base/config.h"

/// A ServerConfig comes from flags, then LIGHTKILN_* variables, then a TOML file, then defaults.
/// One table defines the flags and their help, the variables, the file's keys and the echo.
namespace kiln::cli {

/// One setting of the service in its text form.
struct ConfigRow {
  std::string_view name;  ///< "max_upload_bytes"; the flag is --max-upload-bytes
  bool is_number = false;
  std::string_view expected;  ///< "a number of bytes: 1073741824, 512MiB, 1GiB"
  std::string_view description;
  /// Sets the value. Returns false, and leaves the config unchanged, when the text is not what
  /// `expected` says.
  bool (*parse)(base::ServerConfig&, const std::string& text);
  std::string (*show)(const base::ServerConfig&);
};

const std::vector<ConfigRow>& config_rows();

std::string flag_of(std::string_view name);      ///< "--max-upload-bytes"
std::string variable_of(std::string_view name);  ///< "LIGHTKILN_MAX_UPLOAD_BYTES"

using Environment = std::map<std::string, std::string>;
Environment process_environment();

struct ConfigSources {
  std::map<std::string, std::string> flags;               ///< by row name
  Environment environment;                                ///< all variables of the process
  std::optional<std::filesystem::path> file;              ///< named by the user, so it must exist
  std::filesystem::path default_file = "lightkiln.toml";  ///< used when it exists
};

struct LoadedConfig {
  base::ServerConfig config;
  std::map<std::string, std::string>
      origin;  ///< row name -> "flag", "LIGHTKILN_PORT", file, "default"
};

/// Loads the configuration and reports all problems at once. Errors: `invalid_config`, each place
/// with source "flag", "environment" or "file"; unknown keys and LIGHTKILN_* variables are
/// problems.
proto::Expected<LoadedConfig> load_config(const ConfigSources&);

/// Returns the configuration as TOML that load_config() reads back, each value with its description
/// and origin.
std::string config_text(const LoadedConfig&);

/// Returns $XDG_DATA_HOME/lightkiln, else ~/.local/share/lightkiln, else ./lightkiln-data.
std::filesystem::path default_data_folder(const Environment&);

}  // namespace kiln::cli
