#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"
#include "server/base/principal.h"
#include "server/store/database.h"

namespace kiln::auth {

/// A bearer token as stored. Only the SHA-256 of its secret is kept.
struct Token {
  std::string id;  ///< tok_...
  std::string tenant;
  std::vector<std::string> scopes;     ///< members of kScopes
  std::string created_at;              ///< RFC 3339
  std::string expires_at, revoked_at;  ///< "" when never
  std::array<unsigned char, 32> digest{};
};

inline constexpr std::array<const char*, 3> kScopes{"read", "write", "admin"};

/// The service's tokens, in a database of their own: the command line changes it while the service
/// runs, which sees the change with the next request. Thread-safe. Throws DatabaseError.
class TokenStore {
 public:
  /// Opens or creates the file.
  explicit TokenStore(const std::filesystem::path&);

  struct Created {
    Token token;
    std::string secret;  ///< shown once
  };
  /// Makes a token that is valid for `seconds`; 0: until it is revoked.
  /// Errors: `invalid_request` when the tenant is not 1 to 63 characters of [A-Za-z0-9._-], or a
  /// scope is unknown or missing.
  proto::Expected<Created> create(const std::string& tenant, const std::vector<std::string>& scopes,
                                  std::uint64_t seconds = 0);
  std::vector<Token> list();  ///< oldest first
  /// Errors: `not_found`.
  proto::Expected<void> revoke(const std::string& id);

  /// Returns whether there is, or ever was, a token: then requests need one.
  bool required();
  /// Returns the token's owner, if it is valid now. It takes the same time whichever bytes differ.
  std::optional<base::Principal> authenticate(std::string_view secret);

 private:
  void refresh();  ///< needs mutex_

  std::mutex mutex_;
  store::Database database_;
  std::vector<Token> tokens_;       ///< read at data_version_
  std::int64_t data_version_ = -1;  ///< changes when another process wrote
};

}  // namespace kiln::auth
