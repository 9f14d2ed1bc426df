#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::cli {

/// A top-level value of a TOML file.
struct TomlValue {
  enum class Kind { kInteger, kString, kOther };
  Kind kind = Kind::kOther;
  std::string text;  ///< set for integers and strings
};

/// Reads the top-level keys of a TOML file of at most 1 MiB. Errors: `invalid_config` (with line
/// and column), `missing_file`.
proto::Expected<std::map<std::string, TomlValue>> read_toml(const std::filesystem::path&);

/// Returns the text as a quoted TOML string.
std::string toml_string(std::string_view);

}  // namespace kiln::cli
