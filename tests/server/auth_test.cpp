#include <gtest/gtest.h>

#include <fstream>

#include "server/auth/gate.h"
#include "tests/support/temp_files.h"

namespace kiln::auth {
namespace {

class Tokens : public ::testing::Test {
 protected:
  test::TempFolder folder_;
  TokenStore store_{folder_.path() / "tokens.db"};

  std::string create(const std::string& tenant, const std::vector<std::string>& scopes) {
    return store_.create(tenant, scopes).value().secret;
  }
};

TEST_F(Tokens, AreKnownByTheirDigestOnly) {
  EXPECT_FALSE(store_.required());
  const std::string secret = create("art", {"read", "write"});
  EXPECT_TRUE(secret.starts_with("lk_"));
  EXPECT_EQ(secret.size(), 55u);
  EXPECT_TRUE(store_.required());
  const auto owner = store_.authenticate(secret);
  ASSERT_TRUE(owner);
  EXPECT_EQ(owner->tenant, "art");
  EXPECT_TRUE(owner->read && owner->write);
  EXPECT_FALSE(owner->admin);
  for (const std::string& wrong :
       {std::string(), secret + "x", secret.substr(1), std::string("lk_")})
    EXPECT_FALSE(store_.authenticate(wrong)) << wrong;
  for (const char* name : {"tokens.db", "tokens.db-wal"})
    EXPECT_EQ(test::read_bytes(folder_.path() / name).find(secret), std::string::npos) << name;
}

TEST_F(Tokens, AreRevokedAndExpire) {
  const auto made = store_.create("art", {"read"}).value();
  EXPECT_TRUE(store_.authenticate(made.secret));
  EXPECT_TRUE(store_.revoke(made.token.id));
  EXPECT_FALSE(store_.authenticate(made.secret));
  EXPECT_EQ(store_.revoke(made.token.id).error().code, "not_found");
  EXPECT_TRUE(store_.required()) << "a service whose tokens are all revoked is closed, not open";
  const auto brief = store_.create("art", {"read"}, 1).value();
  EXPECT_TRUE(store_.authenticate(brief.secret));
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));
  EXPECT_FALSE(store_.authenticate(brief.secret));
  EXPECT_EQ(store_.list().size(), 2u);
}

TEST_F(Tokens, OfAnotherProcessAreSeenAtOnce) {
  TokenStore other(folder_.path() / "tokens.db");
  EXPECT_FALSE(store_.required());
  const auto made = other.create("art", {"admin"}).value();
  EXPECT_TRUE(store_.required());
  EXPECT_TRUE(store_.authenticate(made.secret)->admin);
  EXPECT_TRUE(other.revoke(made.token.id));
  EXPECT_FALSE(store_.authenticate(made.secret));
}

TEST_F(Tokens, NeedAPlainTenantAndScopes) {
  for (const auto& tenant : {std::string(), std::string("a b"), std::string("a/b"),
                             std::string(64, 'a'), std::string("ä")})
    EXPECT_EQ(store_.create(tenant, {"read"}).error().code, "invalid_request") << tenant;
  EXPECT_EQ(store_.create("a", {}).error().code, "invalid_request");
  EXPECT_EQ(store_.create("a", {"raed"}).error().code, "invalid_request");
  EXPECT_FALSE(store_.required());
}

http::RequestHead head(const std::string& method, const std::string& headers) {
  return http::parse_head(method + " /v1/jobs HTTP/1.1\r\nHost: bake:8080\r\n" + headers + "\r\n")
      .value();
}

TEST_F(Tokens, TheGateAsksForTokenAndScope) {
  const Gate gate(store_);
  EXPECT_TRUE(gate.admit(head("POST", ""))->admin) << "without tokens everyone may do everything";
  const auto code = [&](const std::string& method, const std::string& headers) {
    const auto admitted = gate.admit(head(method, headers));
    return admitted ? std::string() : admitted.error().code;
  };
  EXPECT_EQ(code("POST", "Origin: http://evil.example\r\n"), "forbidden_origin");
  EXPECT_EQ(code("POST", "Origin: null\r\n"), "forbidden_origin");
  EXPECT_EQ(code("POST", "Origin: http://bake:8080\r\n"), "");
  const std::string reader = create("art", {"read"});
  EXPECT_EQ(code("GET", ""), "unauthorized");
  EXPECT_EQ(code("GET", "Authorization: Basic " + reader + "\r\n"), "unauthorized");
  EXPECT_EQ(code("GET", "Authorization: Bearer\r\n"), "unauthorized");
  EXPECT_EQ(code("GET", "Authorization: Bearer lk_wrong\r\n"), "unauthorized");
  EXPECT_EQ(code("GET", "authorization: bearer  " + reader + "\r\n"), "");
  EXPECT_EQ(code("POST", "Authorization: Bearer " + reader + "\r\n"), "forbidden_scope");
  EXPECT_EQ(code("DELETE", "Authorization: Bearer " + reader + "\r\n"), "forbidden_scope");
  const std::string admin = create("ops", {"admin"});
  EXPECT_EQ(code("POST", "Authorization: Bearer " + admin + "\r\n"), "");
}

TEST(Loopback, IsKnownByNameAndNumber) {
  for (const char* address : {"127.0.0.1", "127.8.9.1", "::1", "localhost"})
    EXPECT_TRUE(is_loopback(address)) << address;
  for (const char* address : {"0.0.0.0", "::", "10.0.0.1", "no.such.host.invalid"})
    EXPECT_FALSE(is_loopback(address)) << address;
}

}  // namespace
}  // namespace kiln::auth
