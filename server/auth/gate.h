#pragma once

#include <string>

#include "proto/expected.h"
#include "server/auth/token_store.h"
#include "server/http/head.h"

namespace kiln::auth {

/// Finds the sender of a request by its head alone, before a byte of its body is read.
class Gate {
 public:
  explicit Gate(TokenStore& tokens) : tokens_(tokens) {}

  /// Without tokens all clients are anonymous and may do everything, except web pages of other
  /// sites: those could otherwise use a visitor's browser to reach a service on loopback.
  /// Errors: `unauthorized`, `forbidden_scope`, `forbidden_origin`.
  proto::Expected<base::Principal> admit(const http::RequestHead&) const;

 private:
  TokenStore& tokens_;
};

/// Returns whether only this machine can reach the address (a name or a number).
bool is_loopback(const std::string& address);

}  // namespace kiln::auth
