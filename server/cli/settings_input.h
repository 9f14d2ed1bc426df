#pragma once

#include <string>
#include <vector>

#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace CLI {
class App;
}

namespace kiln::cli {

/// The flags --settings and --set, and the settings that result from them.
struct SettingsInput {
  std::string file;               ///< "-" for stdin, "" for none
  std::vector<std::string> sets;  ///< "solver.samples=64"; later ones win

  void add_flags(CLI::App&);
  /// Returns the settings document as text, checked against this version's table, or "" when
  /// nothing was given. Errors: `invalid_settings`, `invalid_json`, `missing_file`.
  proto::Expected<std::string> document() const;
  proto::Expected<proto::BakeSettings> settings() const;
};

}  // namespace kiln::cli
