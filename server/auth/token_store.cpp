#include "server/auth/token_store.h"

#include <openssl/crypto.h>

#include <algorithm>

#include "proto/sha256.h"
#include "server/base/clock.h"
#include "server/base/ids.h"

namespace kiln::auth {
namespace {

constexpr std::string_view kSecretPrefix = "lk_";
constexpr std::size_t kMaxTenant = 63;

using Digest = std::array<unsigned char, 32>;

Digest digest_of(std::string_view secret) {
  proto::Sha256 hash;
  hash.update(secret);
  return hash.digest();
}

bool is_tenant(const std::string& name) {
  return !name.empty() && name.size() <= kMaxTenant &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                  std::string_view("._-").find(c) != std::string_view::npos;
         });
}

bool is_scope(const std::string& name) {
  return std::find(kScopes.begin(), kScopes.end(), name) != kScopes.end();
}

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const auto& word : words) out += (out.empty() ? "" : " ") + word;
  return out;
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> words;
  for (std::size_t at = 0; at < text.size();) {
    const auto end = std::min(text.find(' ', at), text.size());
    words.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return words;
}

bool is_valid(const Token& token) {
  return token.revoked_at.empty() &&
         (token.expires_at.empty() || token.expires_at > base::now_rfc3339());
}

base::Principal principal_of(const Token& token) {
  const auto has = [&](const char* scope) {
    return std::find(token.scopes.begin(), token.scopes.end(), scope) != token.scopes.end();
  };
  const bool admin = has("admin");
  return {token.tenant, admin || has("read"), admin || has("write"), admin, token.id};
}

}  // namespace

TokenStore::TokenStore(const std::filesystem::path& path) : database_(path) {
  const std::lock_guard lock(mutex_);
  database_.transaction(store::Database::Durability::kPromise, [&] {
    database_.run(
        "CREATE TABLE IF NOT EXISTS token ("
        " sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE,"
        " digest TEXT NOT NULL UNIQUE, tenant TEXT NOT NULL, scopes TEXT NOT NULL,"
        " created_at TEXT NOT NULL, expires_at TEXT NOT NULL, revoked_at TEXT NOT NULL DEFAULT '')"
        " STRICT");
  });
}

proto::Expected<TokenStore::Created> TokenStore::create(const std::string& tenant,
                                                        const std::vector<std::string>& scopes,
                                                        std::uint64_t seconds) {
  if (!is_tenant(tenant))
    return proto::fail("invalid_request",
                       "A tenant's name has 1 to 63 characters of A-Z a-z 0-9 . _ -");
  if (scopes.empty() || !std::all_of(scopes.begin(), scopes.end(), is_scope))
    return proto::fail("invalid_request", "A token needs scopes: read, write, admin.");
  Created made;
  made.secret = base::new_secret(kSecretPrefix);
  Token& token = made.token;
  token = {base::new_id("tok_"),  tenant, scopes, base::now_rfc3339(), "", "",
           digest_of(made.secret)};
  if (seconds > 0)
    token.expires_at = base::now_rfc3339(std::chrono::seconds(static_cast<std::int64_t>(seconds)));
  const std::lock_guard lock(mutex_);
  database_.transaction(store::Database::Durability::kPromise, [&] {
    auto insert = database_.prepare(
        "INSERT INTO token (id, digest, tenant, scopes, created_at, expires_at)"
        " VALUES (?,?,?,?,?,?)");
    insert.bind(1, token.id).bind(2, proto::sha256_hex(made.secret)).bind(3, tenant);
    insert.bind(4, joined(scopes)).bind(5, token.created_at).bind(6, token.expires_at).step();
  });
  data_version_ = -1;
  return made;
}

proto::Expected<void> TokenStore::revoke(const std::string& id) {
  const std::lock_guard lock(mutex_);
  bool found = false;
  database_.transaction(store::Database::Durability::kPromise, [&] {
    auto update = database_.prepare(
        "UPDATE token SET revoked_at=? WHERE id=? AND revoked_at='' RETURNING id");
    update.bind(1, base::now_rfc3339()).bind(2, id);
    while (update.step()) found = true;
  });
  data_version_ = -1;
  if (found) return {};
  return proto::fail("not_found", "There is no valid token " + id + ".");
}

void TokenStore::refresh() {
  auto version = database_.prepare("PRAGMA data_version");
  version.step();
  if (version.number(0) == data_version_) return;
  std::vector<Token> tokens;
  auto rows = database_.prepare(
      "SELECT id, digest, tenant, scopes, created_at, expires_at, revoked_at FROM token"
      " ORDER BY sequence");
  while (rows.step()) {
    Token& token = tokens.emplace_back();
    token.id = rows.text(0);
    const std::string hex = rows.text(1);
    for (std::size_t i = 0; i < token.digest.size() && 2 * i + 1 < hex.size(); ++i)
      token.digest[i] = static_cast<unsigned char>(std::stoi(hex.substr(2 * i, 2), nullptr, 16));
    token.tenant = rows.text(2);
    token.scopes = split(rows.text(3));
    token.created_at = rows.text(4);
    token.expires_at = rows.text(5);
    token.revoked_at = rows.text(6);
  }
  tokens_ = std::move(tokens);
  data_version_ = version.number(0);
}

std::vector<Token> TokenStore::list() {
  const std::lock_guard lock(mutex_);
  refresh();
  return tokens_;
}

bool TokenStore::required() {
  const std::lock_guard lock(mutex_);
  refresh();
  return !tokens_.empty();
}

std::optional<base::Principal> TokenStore::authenticate(std::string_view secret) {
  const Digest digest = digest_of(secret);
  const std::lock_guard lock(mutex_);
  refresh();
  std::optional<base::Principal> found;
  for (const Token& token : tokens_)  // all of them: where the match lies must not show
    if (CRYPTO_memcmp(token.digest.data(), digest.data(), digest.size()) == 0 && is_valid(token))
      found = principal_of(token);
  return found;
}

}  // namespace kiln::auth
