#pragma once

#include <chrono>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "proto/expected.h"
#include "server/webhooks/networks.h"

namespace kiln::webhooks {

/// Checks a URL as far as that is possible without a look-up. Errors: `invalid_request` when it is
/// no http or https URL, names a user, or is an address that may not be reached.
proto::Expected<void> check_webhook_url(const std::string& url, const Networks& allowed);

/// One message, ready to be sent.
struct WebhookMessage {
  std::string id, url, body;
  std::int64_t timestamp = 0;       ///< of this try, in Unix seconds
  std::vector<std::string> keys{};  ///< to sign with, each
};

struct WebhookAnswer {
  int status = 0;     ///< 0: there was none
  std::string error;  ///< why not, in words that name no address
  bool delivered() const { return status >= 200 && status < 300; }
};

struct WebhookLimits {
  std::chrono::milliseconds connect{5'000}, total{15'000};
  std::size_t answer_bytes = std::size_t{64} * 1024;  ///< read of an answer's body
};

/// POSTs one message. No redirects, no proxy of the environment, no credentials; the address that
/// is connected to is checked when it is, so a name can't change between check and use. Blocks for
/// at most limits.total, less when stopped. Callable from many threads.
WebhookAnswer send_webhook(const WebhookMessage&, const Networks& allowed, const WebhookLimits&,
                           const std::stop_token&);

}  // namespace kiln::webhooks
