#include <gtest/gtest.h>
#include <signal.h>

#include <nlohmann/json.hpp>

#include "server/webhooks/signature.h"
#include "tests/http/live.h"
#include "tests/http/program.h"
#include "tests/http/receiver.h"

/// Webhooks of jobs, from a live service to a receiver on loopback.
namespace kiln::test {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;

constexpr const char* kSecret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

class Webhook : public testing::Test {
 protected:
  jobs::FakeBake fake_;
  TempFolder folder_;

  base::ServerConfig config() {
    base::ServerConfig config;
    config.webhook_networks = "127.0.0.0/8";
    config.webhook_secrets =
        folder_.write("secrets", std::string("ci = ") + kSecret + "\nart/own = " + kSecret + "\n");
    return config;
  }
  static server::ServiceParts parts(jobs::BakeFunction bake,
                                    webhooks::WebhookDelays delays = {milliseconds(50)}) {
    server::ServiceParts parts;
    parts.bake = std::move(bake);
    parts.webhook_delays = std::move(delays);
    parts.webhook_limits.total = milliseconds(1'500);
    return parts;
  }
  static Answer post(std::uint16_t port, const json& hook) {
    const json options{{"dedupe", false}, {"webhook", hook}};
    return ask(port, "POST", "/v1/jobs", {kForm},
               form({{"name=\"scene\"; filename=\"a.glb\"", "glTF"},
                     {"name=\"options\"", options.dump()}}));
  }
  static Answer try_out(std::uint16_t port, const json& hook) {
    return ask(port, "POST", "/v1/webhooks/test", {"Content-Type: application/json"}, hook.dump());
  }
  static std::string metrics(const Live& live) {
    return ask(live.service->admin_port(), "GET", "/metrics").body;
  }
  static bool reaches(const Live& live, const std::string& line) {
    for (int i = 0; i < 500; ++i) {
      if (metrics(live).find(line) != std::string::npos) return true;
      std::this_thread::sleep_for(milliseconds(10));
    }
    return false;
  }
};

TEST_F(Webhook, TellsOfTheEndSignedAsTheStandardSays) {
  Receiver receiver;
  const Live live(parts(fake_.instant()), config());
  const Answer made = post(live.port(), {{"url", receiver.url()}, {"secret_ref", "ci"}});
  ASSERT_EQ(made.status, 202) << made.body;
  const json shown = json::parse(made.body)["webhook"];
  EXPECT_EQ(shown, (json{{"url", receiver.url()}, {"events", {"job.end"}}, {"secret_ref", "ci"}}));
  const auto messages = receiver.wait(1);
  ASSERT_EQ(messages.size(), 1u);
  const auto& m = messages[0];
  EXPECT_EQ(m.request_line, "POST /hook HTTP/1.1");
  EXPECT_EQ(m.header("content-type"), "application/json");
  const json body = json::parse(m.body);
  EXPECT_EQ(body["type"], "job.end");
  EXPECT_EQ(body["data"]["job"], member(made.body, "id"));
  EXPECT_EQ(body["data"]["state"], "succeeded");
  EXPECT_EQ(
      m.header("webhook-signature"),
      webhooks::webhook_signature(webhooks::webhook_key(kSecret).value(), m.header("webhook-id"),
                                  std::stoll(m.header("webhook-timestamp")), m.body));
  EXPECT_NEAR(double(std::stoll(m.header("webhook-timestamp"))), double(std::time(nullptr)), 30);
  EXPECT_EQ(m.body.find(kSecret), std::string::npos);
  EXPECT_TRUE(reaches(live, "webhook_tries_total{outcome=\"delivered\"} 1\n"));
  EXPECT_TRUE(reaches(live, "\nwebhook_pending 0\n"));
}

TEST_F(Webhook, TellsOfTheEventsThatItNames) {
  Receiver receiver;
  const Live live(parts(fake_.instant(2)), config());
  const json events{"job.state", "pass.completed", "result.ready", "job.end"};
  ASSERT_EQ(post(live.port(), {{"url", receiver.url()}, {"events", events}}).status, 202);
  std::map<std::string, int> types;
  for (const auto& message : receiver.wait(8)) {
    ++types[json::parse(message.body)["type"].get<std::string>()];
    EXPECT_EQ(message.header("webhook-signature"), "") << "no secret_ref, no signature";
  }
  EXPECT_EQ(types["pass.completed"], 2);
  EXPECT_EQ(types["result.ready"], 1);
  EXPECT_EQ(types["job.end"], 1);
  EXPECT_GE(types["job.state"], 3);
}

TEST_F(Webhook, TriesAgainWithTheSameIdUntilItIsTaken) {
  Receiver receiver({Receiver::kFailed,
                     "HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\n"
                     "Connection: close\r\n\r\n",
                     "garbage\r\n\r\n", Receiver::kTaken});
  const webhooks::WebhookDelays delays(7, milliseconds(30));
  const Live live(parts(fake_.instant(), delays), config());
  ASSERT_EQ(post(live.port(), {{"url", receiver.url()}, {"secret_ref", "ci"}}).status, 202);
  const auto messages = receiver.wait(4);
  ASSERT_EQ(messages.size(), 4u);
  for (const auto& message : messages) {
    EXPECT_EQ(message.header("webhook-id"), messages[0].header("webhook-id"));
    EXPECT_EQ(message.body, messages[0].body);
    EXPECT_EQ(message.request_line, messages[0].request_line) << "redirects are not followed";
  }
  EXPECT_TRUE(reaches(live, "webhook_tries_total{outcome=\"retried\"} 3\n"));
  EXPECT_TRUE(reaches(live, "\nwebhook_pending 0\n"));
  EXPECT_EQ(receiver.wait(5, milliseconds(200)).size(), 4u);
}

TEST_F(Webhook, GivesUpAfterTheLastTryAndWhenTheReceiverIsGone) {
  EXPECT_EQ(webhooks::kWebhookDelays.size(), 7u) << "eight tries";
  EXPECT_EQ(webhooks::kWebhookDelays.front(), std::chrono::seconds(5));
  EXPECT_EQ(webhooks::kWebhookDelays.back(), std::chrono::hours(6));
  Receiver failing({Receiver::kFailed});
  Receiver gone({"HTTP/1.1 410 Gone\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"});
  const Live live(parts(fake_.instant(), webhooks::WebhookDelays(2, milliseconds(20))), config());
  ASSERT_EQ(post(live.port(), {{"url", failing.url()}}).status, 202);
  ASSERT_EQ(post(live.port(), {{"url", gone.url()}}).status, 202);
  EXPECT_EQ(failing.wait(3).size(), 3u);
  EXPECT_TRUE(reaches(live, "webhook_tries_total{outcome=\"failed\"} 2\n"));
  EXPECT_TRUE(reaches(live, "\nwebhook_pending 0\n"));
  EXPECT_EQ(failing.wait(4, milliseconds(200)).size(), 3u);
  EXPECT_EQ(gone.wait(2, milliseconds(1)).size(), 1u);
}

TEST_F(Webhook, HangingAndEndlessReceiversHoldUpNoOther) {
  Receiver hanging({""});
  Receiver endless(
      {"HTTP/1.1 200 OK\r\nContent-Length: 99999999\r\n\r\n" + std::string(300'000, 'x')});
  Receiver good;
  server::ServiceParts patient = parts(fake_.instant());
  patient.webhook_limits.total = std::chrono::seconds(60);
  const Live live(std::move(patient), config());
  for (int i = 0; i < 6; ++i) post(live.port(), {{"url", hanging.url()}});
  ASSERT_EQ(hanging.wait(2).size(), 2u);
  const auto began = std::chrono::steady_clock::now();
  post(live.port(), {{"url", good.url()}});
  post(live.port(), {{"url", endless.url()}});
  EXPECT_EQ(good.wait(1).size(), 1u);
  EXPECT_EQ(endless.wait(1).size(), 1u);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(45))
      << "two hang for a minute, two threads are left";
  EXPECT_TRUE(reaches(live, "webhook_tries_total{outcome=\"delivered\"} 2\n"))
      << "a status of 2xx will do, whatever comes after it";
}

TEST_F(Webhook, ReachesPublicAddressesOnlyUnlessAllowed) {
  Receiver receiver;
  base::ServerConfig strict = config();
  strict.webhook_networks = "";
  const Live live(parts(fake_.instant()), strict);
  const Answer refused = post(live.port(), {{"url", receiver.url()}});
  EXPECT_EQ(refused.status, 422) << "an address that is written out";
  EXPECT_NE(refused.body.find("\"/webhook/url\""), std::string::npos);
  // A name is looked up when it is used: what it resolves to is checked then.
  const std::string by_name = "http://localhost:" + std::to_string(receiver.port()) + "/";
  const Answer tried = try_out(live.port(), {{"url", by_name}});
  EXPECT_EQ(tried.status, 202) << tried.body;
  EXPECT_EQ(member(tried.body, "delivered"), "false");
  EXPECT_NE(member(tried.body, "error").find("not a public one"), std::string::npos) << tried.body;
  ASSERT_EQ(post(live.port(), {{"url", by_name}}).status, 202);
  EXPECT_TRUE(reaches(live, "webhook_tries_total{outcome=\"failed\"} 1\n"));
  EXPECT_TRUE(receiver.wait(1, milliseconds(100)).empty());
}

TEST_F(Webhook, CanBeTriedOut) {
  Receiver receiver({Receiver::kTaken, Receiver::kFailed});
  const Live live(parts(fake_.instant()), config());
  const json hook{{"url", receiver.url()}, {"secret_ref", "ci"}};
  const Answer good = try_out(live.port(), hook);
  EXPECT_EQ(good.status, 202);
  EXPECT_EQ(member(good.body, "delivered"), "true");
  EXPECT_EQ(member(good.body, "status"), "204");
  const auto message = receiver.wait(1).at(0);
  EXPECT_EQ(json::parse(message.body)["type"], "webhook.test");
  EXPECT_EQ(message.header("webhook-id"), member(good.body, "id"));
  EXPECT_TRUE(message.header("webhook-signature").starts_with("v1,"));
  const Answer bad = try_out(live.port(), hook);
  EXPECT_EQ(member(bad.body, "delivered"), "false");
  EXPECT_EQ(member(bad.body, "status"), "500");
  EXPECT_EQ(receiver.wait(3, milliseconds(200)).size(), 2u) << "tried once only";
}

TEST_F(Webhook, RefusesWhatItCanNotSend) {
  const Live live(parts(fake_.instant()), config());
  struct Case {
    json hook;
    const char* pointer;
  };
  const std::string url = "https://example.com/";
  for (const auto& [hook, pointer] : std::vector<Case>{
           {json::object(), "/webhook/url"},
           {"x", "/webhook"},
           {{{"url", "ftp://example.com"}}, "/webhook/url"},
           {{{"url", "http://a:b@example.com"}}, "/webhook/url"},
           {{{"url", url}, {"secret_ref", "none"}}, "/webhook/secret_ref"},
           {{{"url", url}, {"secret_ref", "own"}}, "/webhook/secret_ref"},  // another tenant's
           {{{"url", url}, {"secret_ref", "../x"}}, "/webhook/secret_ref"},
           {{{"url", url}, {"events", {"job.ended"}}}, "/webhook/events/0"},
           {{{"url", url}, {"events", json::array()}}, "/webhook/events"},
           {{{"url", url}, {"events", {"job.end", "job.end"}}}, "/webhook/events/1"},
           {{{"url", url}, {"secret", kSecret}}, "/webhook/secret"}}) {
    const Answer answer = post(live.port(), hook);
    EXPECT_EQ(answer.status, 422) << hook << answer.body;
    EXPECT_NE(answer.body.find("\"" + std::string(pointer) + "\""), std::string::npos)
        << answer.body;
    EXPECT_EQ(answer.body.find("MfKQ9r8"), std::string::npos);
  }
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").body.find("job_"), std::string::npos);
  EXPECT_EQ(try_out(live.port(), {{"url", url}, {"evnts", 1}}).status, 422);
}

// The message is in the store before the client hears that the job ended.
TEST_F(Webhook, SurviveAKilledService) {
  Receiver receiver({Receiver::kFailed, Receiver::kTaken});
  const auto data = folder_.path() / "data";
  const auto scene = write_small_scene(folder_.path());
  const std::vector<std::string> flags{"--webhook-networks", "127.0.0.0/8", "--webhook-secrets",
                                       config().webhook_secrets.string()};
  std::string id;
  {
    Program killed(data, flags);
    const json options{{"webhook", {{"url", receiver.url()}, {"secret_ref", "ci"}}}};
    const Answer made =
        curl("-F scene=@" + scene.string() +
             " -F 'settings={\"solver\":{\"samples\":16}}' -F 'options=" + options.dump() + "' " +
             killed.url("/v1/jobs"));
    ASSERT_EQ(made.status, 202) << made.body;
    ASSERT_EQ(receiver.wait(1, std::chrono::seconds(60)).size(), 1u);
    killed.signal(SIGKILL);  // the next try is due in five seconds
    killed.wait_exit();
    EXPECT_EQ(killed.log().find(kSecret), std::string::npos);
  }
  Program program(data, flags);
  const auto messages = receiver.wait(2, std::chrono::seconds(45));
  ASSERT_EQ(messages.size(), 2u);
  EXPECT_EQ(messages[0].header("webhook-id"), messages[1].header("webhook-id"));
  EXPECT_EQ(messages[0].body, messages[1].body);
}

TEST_F(Webhook, ConfigurationThatIsWrongKeepsTheServiceFromStarting) {
  base::ServerConfig wrong = config();
  wrong.data = folder_.path() / "data";
  wrong.port = wrong.admin_port = 0;
  wrong.webhook_secrets = folder_.write("wrong", "ci = hunter2\n");
  const auto started = server::Service::start(wrong, parts(fake_.instant()));
  ASSERT_FALSE(started);
  EXPECT_EQ(started.error().code, "invalid_config");
  EXPECT_EQ(started.error().message.find("hunter2"), std::string::npos);
}

}  // namespace
}  // namespace kiln::test
