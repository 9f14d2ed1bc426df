#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "proto/expected.h"

/// Signatures by which receivers know that a message is ours and new:
/// https://www.standardwebhooks.com.
namespace kiln::webhooks {

/// The bytes of a secret as it is written: "whsec_" and the base64 of 24 to 64 bytes.
/// Errors: `invalid_config`; the message does not hold the secret.
proto::Expected<std::string> webhook_key(std::string_view secret);

/// "v1,<base64 of the HMAC-SHA256 of id.timestamp.body>".
std::string webhook_signature(std::string_view key, std::string_view id, std::int64_t timestamp,
                              std::string_view body);

}  // namespace kiln::webhooks
