#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"

namespace kiln::proto {

class ProblemList;

/// The events of a job that a webhook can receive.
inline constexpr std::array<std::string_view, 4> kWebhookEvents{"job.state", "pass.completed",
                                                                "result.ready", "job.end"};

/// The receiver of a job's events, as the client described it.
struct Webhook {
  static constexpr std::size_t kMaxUrl = 2048, kMaxSecretRef = 63;

  std::string url;                             ///< http or https
  std::vector<std::string> events{"job.end"};  ///< from kWebhookEvents, each once
  std::string secret_ref;  ///< name of a secret in the service's configuration; "": not signed

  bool wants(std::string_view event) const;
};

nlohmann::json to_json(const Webhook&);
/// Errors: `invalid_request`.
Expected<Webhook> webhook_from_json(const nlohmann::json&);
/// Reads a webhook that is a member of a larger document. It adds what is wrong to the list, with
/// pointers below `pointer`.
std::optional<Webhook> read_webhook(const nlohmann::json&, const std::string& pointer,
                                    ProblemList&);

}  // namespace kiln::proto
