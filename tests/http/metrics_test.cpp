#include <gtest/gtest.h>

#include "tests/http/live.h"

namespace kiln::test {
namespace {

TEST(Metrics, CountJobsRequestsAndCommits) {
  jobs::FakeBake fake;
  const Live live(fake.instant(3));
  const std::string id = post_job(live.port()), path = "/v1/jobs/" + id;
  EXPECT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  ask(live.port(), "GET", "/v1/jobs/" + std::string(26, 'x'));
  ask(live.port(), "GET", "/no/such/path");
  Answer answer;
  do {  // the runner lets go of a job a moment after its end is known
    answer = ask(live.service->admin_port(), "GET", "/metrics");
  } while (answer.body.find("bake_jobs{state=\"running\"} 1") != std::string::npos);
  EXPECT_EQ(answer.status, 200);
  EXPECT_TRUE(answer.headers.at("content-type").starts_with("text/plain; version=0.0.4"));
  const std::string& text = answer.body;
  for (const char* line :
       {"\nbake_jobs_ended_total{state=\"succeeded\"} 1\n", "\nbake_queue_seconds_count 1\n",
        "\nbake_jobs{state=\"queued\"} 0\n", "\nbake_jobs{state=\"running\"} 0\n",
        "\nbake_pass_seconds_count{pass=\"bounce\"} 3\n", "\nsse_clients 0\n", "\nbuild_info{"})
    EXPECT_NE(text.find(line), std::string::npos) << line << text;
  for (const char* label : {"route=\"/v1/jobs/{}\"", "code=\"404\"", "route=\"none\""})
    EXPECT_NE(text.find(label), std::string::npos) << label << text;
  EXPECT_EQ(text.find("store_commit_seconds_count 0\n"), std::string::npos);
  EXPECT_EQ(text.find(id), std::string::npos) << "a series per job would grow without end";
  EXPECT_EQ(ask(live.port(), "GET", "/metrics").status, 404) << "on the admin port only";
}

}  // namespace
}  // namespace kiln::test
