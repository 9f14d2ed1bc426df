#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/un.h>

#include "proto/webhook.h"
#include "server/webhooks/networks.h"
#include "server/webhooks/secrets.h"
#include "server/webhooks/sender.h"
#include "server/webhooks/signature.h"
#include "tests/support/temp_files.h"

namespace kiln::webhooks {
namespace {

constexpr const char* kSecret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

// The example of the Standard Webhooks libraries.
TEST(WebhookSignature, IsThatOfTheStandard) {
  const auto key = webhook_key(kSecret);
  ASSERT_TRUE(key);
  EXPECT_EQ(key->size(), 24u);
  EXPECT_EQ(webhook_signature(*key, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330,
                              R"({"test": 2432232314})"),
            "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
}

TEST(WebhookSignature, NeedsASecretOfTheRightForm) {
  EXPECT_EQ(webhook_key("whsec_" + std::string(42, 'A') + "A=")->size(), 32u);
  for (const std::string odd :
       {"", "whsec_", "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "whsec_MfKQ",
        "whsec_MfKQ9r8GKYqrTwjUPD8I", "whsec_!!KQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw",
        "whsec_====", "whsec_a==="}) {
    const auto key = webhook_key(odd);
    ASSERT_FALSE(key) << odd;
    EXPECT_EQ(key.error().code, "invalid_config");
  }
  EXPECT_FALSE(webhook_key("whsec_" + std::string(4000, 'A')));
}

TEST(WebhookSecrets, AreOfATenantOrOfAll) {
  const test::TempFolder folder;
  const std::string other = "whsec_" + std::string(32, 'B');
  const auto secrets = WebhookSecrets::read(
      folder.write("secrets", std::string("# a comment\n\nci = ") + kSecret +
                                  "\r\nart/ci=" + other + "\nci=" + other + "\n"));
  ASSERT_TRUE(secrets) << secrets.error().message;
  EXPECT_EQ(secrets->keys("", "ci").size(), 2u) << "both sign while a secret is being changed";
  EXPECT_EQ(secrets->keys("game", "ci").front(), webhook_key(kSecret).value());
  EXPECT_EQ(secrets->keys("art", "ci"), std::vector{webhook_key(other).value()});
  EXPECT_TRUE(secrets->keys("", "none").empty());
}

TEST(WebhookSecrets, NeverShowThemselvesInErrors) {
  for (const char* text : {"ci = hunter2secret", "hunter2secret", "a b = hunter2secret",
                           "a/b/c = whsec_hunter2secret"}) {
    const auto secrets = WebhookSecrets::parse(std::string("# first\n") + text);
    ASSERT_FALSE(secrets) << text;
    EXPECT_EQ(secrets.error().code, "invalid_config");
    EXPECT_NE(secrets.error().message.find("line 2"), std::string::npos);
    EXPECT_EQ(secrets.error().message.find("hunter2"), std::string::npos);
  }
  EXPECT_EQ(WebhookSecrets::read("/no/such/file").error().code, "io_error");
}

bool reach(const std::string& text, const std::string& allowed = "") {
  const Networks networks = Networks::parse(allowed).value();
  sockaddr_in v4{};
  v4.sin_family = AF_INET;
  if (::inet_pton(AF_INET, text.c_str(), &v4.sin_addr) == 1)
    return may_reach(reinterpret_cast<const sockaddr&>(v4), networks);
  sockaddr_in6 v6{};
  v6.sin6_family = AF_INET6;
  EXPECT_EQ(::inet_pton(AF_INET6, text.c_str(), &v6.sin6_addr), 1) << text;
  return may_reach(reinterpret_cast<const sockaddr&>(v6), networks);
}

TEST(WebhookNetworks, ReachOnlyWhatIsPublic) {
  for (const char* address :
       {"8.8.8.8", "1.1.1.1", "172.15.255.255", "172.32.0.1", "100.63.0.1", "100.128.0.1",
        "169.253.1.1", "223.255.255.254", "11.0.0.1", "126.0.0.1", "128.0.0.1", "192.169.0.1",
        "2606:4700:4700::1111", "2a00:1450::1", "64:ff9b::808:808", "2002:808:808::1",
        "::ffff:8.8.8.8"})
    EXPECT_TRUE(reach(address)) << address;
  for (const char* address : {"0.0.0.0",
                              "10.1.2.3",
                              "100.64.0.1",
                              "127.0.0.1",
                              "127.8.8.8",
                              "169.254.169.254",
                              "172.16.0.1",
                              "172.31.255.255",
                              "192.0.0.192",
                              "192.0.2.1",
                              "192.168.1.1",
                              "198.18.0.1",
                              "198.51.100.1",
                              "203.0.113.1",
                              "224.0.0.1",
                              "240.0.0.1",
                              "255.255.255.255",
                              "::",
                              "::1",
                              "::ffff:127.0.0.1",
                              "::ffff:10.0.0.1",
                              "::127.0.0.1",
                              "fc00::1",
                              "fd00:ec2::254",
                              "fe80::1",
                              "fec0::1",
                              "ff02::1",
                              "2001::1",
                              "2001:db8::1",
                              "100::1",
                              "64:ff9b::7f00:1",
                              "64:ff9b::a9fe:a9fe",
                              "64:ff9b:1::1",
                              "2002:7f00:1::1",
                              "2002:a00:1::1"})
    EXPECT_FALSE(reach(address)) << address;
}

TEST(WebhookNetworks, MayBeAllowed) {
  EXPECT_TRUE(reach("10.1.2.3", "10.0.0.0/8"));
  EXPECT_TRUE(reach("::ffff:10.1.2.3", "10.0.0.0/8"));
  EXPECT_FALSE(reach("10.1.2.3", "10.1.2.0/31, 10.1.2.2"));
  EXPECT_TRUE(reach("10.1.2.2", "10.1.2.0/31, 10.1.2.2"));
  EXPECT_TRUE(reach("fd12::1", "192.168.0.0/16,fd00::/8"));
  EXPECT_FALSE(reach("127.0.0.1", "10.0.0.0/8"));
  EXPECT_TRUE(reach("127.0.0.1", "0.0.0.0/0"));
  for (const char* odd : {"10.0.0.0/33", "10.0.0.0/", "10.0.0.0/x", "::1/129", "example.com", "/8",
                          "10.0.0.0/-1", "10.0.0.0/8/8"})
    EXPECT_FALSE(Networks::parse(odd)) << odd;
  sockaddr_un local{};
  local.sun_family = AF_UNIX;
  EXPECT_FALSE(may_reach(reinterpret_cast<const sockaddr&>(local), Networks()));
}

TEST(WebhookTarget, IsAnHttpUrlOfAPublicHost) {
  const Networks none, loopback = Networks::parse("127.0.0.0/8 ::1").value();
  EXPECT_TRUE(check_webhook_url("https://Example.com/a?b", none));
  EXPECT_TRUE(check_webhook_url("http://8.8.8.8:81", none));
  EXPECT_TRUE(check_webhook_url("http://127.0.0.1:9/x", loopback));
  EXPECT_TRUE(check_webhook_url("http://[::1]:9/x", loopback));
  EXPECT_TRUE(check_webhook_url("http://localhost/", none)) << "names are looked up later";
  for (const char* url :
       {"", "x", "ftp://example.com/", "file:///etc/passwd", "gopher://example.com",
        "http://user@example.com/", "http://user:word@example.com/", "http://127.0.0.1/",
        "http://2130706433/", "http://0x7f000001/", "http://0177.0.0.1/", "http://127.1/",
        "http://[::1]/", "http://[::ffff:169.254.169.254]/", "https://10.0.0.1:8080/x",
        "http://[fe80::1%25eth0]/", "http://", "http://example.com:99999/"}) {
    const auto target = check_webhook_url(url, none);
    ASSERT_FALSE(target) << url;
    EXPECT_EQ(target.error().code, "invalid_request");
    EXPECT_EQ(target.error().details.at(0).pointer, "/webhook/url");
  }
}

}  // namespace
}  // namespace kiln::webhooks
