#include <gtest/gtest.h>

#include <future>

#include "tests/http/live.h"

/// Requests that wait: for a job's end, or for its next version.
namespace kiln::test {
namespace {

using Clock = std::chrono::steady_clock;

class Wait : public testing::Test {
 protected:
  jobs::FakeBake fake_;
};

TEST_F(Wait, SinceAVersionAnswersWithTheNextOrThatThereIsNone) {
  const Live live(fake_.instant());
  const std::string path = "/v1/jobs/" + post_job(live.port());
  const Answer done = ask(live.port(), "GET", path + "?wait=20");
  const std::string version = member(done.body, "version");
  const Answer same = ask(live.port(), "GET", path + "?since=" + version);
  EXPECT_EQ(same.status, 304);
  EXPECT_EQ(same.headers.at("etag"), "\"" + version + "\"");
  EXPECT_TRUE(same.body.empty());
  EXPECT_EQ(ask(live.port(), "GET", path + "?wait=20&since=" + version).status, 304)
      << "at once: it is over";
  EXPECT_EQ(ask(live.port(), "GET", path + "?wait=20&since=1").status, 200);
  EXPECT_EQ(ask(live.port(), "GET", path + "?since=x").status, 400);
}

TEST_F(Wait, SinceAVersionSleepsUntilTheJobChanges) {
  base::ServerConfig config;
  config.max_running_jobs = 1;
  const Live live(fake_.holding(), config);
  const std::string first = post_job(live.port());
  ASSERT_EQ(wait_for_state(live.port(), first, "running"), "running");
  const std::string path = "/v1/jobs/" + post_job(live.port());  // waits behind the first
  const std::string version = member(ask(live.port(), "GET", path).body, "version");

  const auto began = Clock::now();
  EXPECT_EQ(ask(live.port(), "GET", path + "?wait=1&since=" + version).status, 304);
  EXPECT_GE(Clock::now() - began, std::chrono::milliseconds(900));

  auto waiting = std::async(std::launch::async, [&] {
    return ask(live.port(), "GET", path + "?wait=30&since=" + version);
  });
  EXPECT_EQ(waiting.wait_for(std::chrono::milliseconds(200)), std::future_status::timeout);
  const Answer patched = ask(live.port(), "PATCH", path, {"Content-Type: application/json"},
                             R"({"labels":{"a":"b"}})");
  EXPECT_EQ(patched.status, 200) << patched.body;
  const Answer news = waiting.get();
  EXPECT_LT(Clock::now() - began, std::chrono::seconds(15));
  EXPECT_EQ(news.status, 200);
  EXPECT_EQ(member(news.body, "version"), member(patched.body, "version"));
  fake_.go = true;
}

std::vector<std::string> prefer(const std::string& value) {
  return {"Content-Type: model/gltf-binary", "Prefer: " + value};
}

TEST_F(Wait, PreferMakesAPostAnswerWithTheEnd) {
  const Live live(fake_.instant());
  const Answer done =
      ask(live.port(), "POST", "/v1/jobs", prefer("respond-async, Wait=20"), "glTF");
  EXPECT_EQ(done.status, 200) << done.body;
  EXPECT_EQ(member(done.body, "state"), "succeeded");
  EXPECT_EQ(done.headers.at("preference-applied"), "wait=20");
  EXPECT_EQ(done.headers.at("location"), "/v1/jobs/" + member(done.body, "id"));
}

TEST_F(Wait, PreferOnAJobThatTakesLongerIsTheUsualAnswer) {
  const Live live(fake_.holding());
  const auto began = Clock::now();
  const Answer going = ask(live.port(), "POST", "/v1/jobs", prefer("wait=1"), "glTF");
  EXPECT_EQ(going.status, 202);
  EXPECT_GE(Clock::now() - began, std::chrono::milliseconds(900));
  EXPECT_EQ(going.headers.at("preference-applied"), "wait=1");
  for (const char* odd : {"wait=", "wait=soon", "wait=-1", "waiting=9", ""}) {
    const Answer at_once =
        ask(live.port(), "POST", "/v1/jobs", prefer(odd), std::string("glTF") + odd);
    EXPECT_EQ(at_once.status, 202) << odd;
    EXPECT_FALSE(at_once.headers.contains("preference-applied")) << odd;
  }
  fake_.go = true;
}

}  // namespace
}  // namespace kiln::test
