#include <gtest/gtest.h>

#include "proto/sha256.h"
#include "tests/http/live.h"

/// GET /v1/jobs/{id}/results/log.txt in every state of a job.
namespace kiln::test {
namespace {

TEST(JobLogRoute, CanBeReadWhileTheJobRunsAndIsAResultAfterwards) {
  jobs::FakeBake fake;
  const Live live(fake.holding());
  const std::string id = post_job(live.port()), path = "/v1/jobs/" + id + "/results";
  EXPECT_EQ(wait_for_state(live.port(), id, "running"), "running");
  const Answer early = ask(live.port(), "GET", path + "/log.txt");
  EXPECT_EQ(early.status, 200);
  EXPECT_EQ(early.headers.at("content-type"), "text/plain; charset=utf-8");
  EXPECT_EQ(early.headers.at("cache-control"), "no-store");
  EXPECT_NE(early.body.find("stage solve\n"), std::string::npos) << early.body;
  EXPECT_EQ(ask(live.port(), "GET", path + "/page_00.exr").status, 425);
  fake.go = true;
  EXPECT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  const Answer late = ask(live.port(), "GET", path + "/log.txt");
  EXPECT_EQ(late.status, 200);
  EXPECT_TRUE(late.body.starts_with(early.body));
  EXPECT_EQ(late.headers.at("etag"), "\"" + proto::sha256_hex(late.body) + "\"");
  EXPECT_NE(ask(live.port(), "GET", path).body.find("/results/log.txt"), std::string::npos);
}

TEST(JobLogRoute, TellsWhyAJobFailed) {
  const Live live(jobs::FakeBake::throwing([] { throw std::bad_alloc(); }));
  const std::string id = post_job(live.port());
  EXPECT_EQ(wait_for_state(live.port(), id, "failed"), "failed");
  Answer log;
  for (int i = 0; i < 200 && log.body.find("state failed") == std::string::npos; ++i) {
    log = ask(live.port(), "GET", "/v1/jobs/" + id + "/results/log.txt");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_NE(log.body.find("state failed: out_of_memory"), std::string::npos) << log.body;
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/" + id + "/results/page_00.exr").status, 404);
}

}  // namespace
}  // namespace kiln::test
