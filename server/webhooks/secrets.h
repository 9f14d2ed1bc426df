#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "proto/expected.h"

namespace kiln::webhooks {

/// Holds the secrets that messages are signed with, by name. They come from a file of lines "name =
/// whsec_..."; a name that has several signs with each of them, so that a secret can be changed
/// without a gap. "tenant/name" is of one tenant, "name" of all of them.
class WebhookSecrets {
 public:
  /// Blank lines and those that begin with # are left out.
  /// Errors: `invalid_config` with the line's number, never its text; `io_error`.
  static proto::Expected<WebhookSecrets> read(const std::filesystem::path&);
  static proto::Expected<WebhookSecrets> parse(const std::string& text);

  /// Returns the keys of this name: the tenant's own before the common ones. None: no such name.
  std::vector<std::string> keys(const std::string& tenant, const std::string& name) const;

 private:
  std::map<std::string, std::vector<std::string>> keys_;
};

}  // namespace kiln::webhooks
