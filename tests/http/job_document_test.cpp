#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/http/program.h"

/// What a job's document says beside its course.
namespace kiln::test {
namespace {

class JobDocument : public testing::Test {
 protected:
  TempFolder folder;
  Program program{folder.path() / "data", {"--max-running-jobs", "1"}};
  const std::filesystem::path scene = write_scene(folder.path(), "cornell");

  std::string job(const std::string& id) {
    return ask(program.port(), "GET", "/v1/jobs/" + id).body;
  }
  std::string position(const std::string& id) { return member(job(id), "queue_position"); }
};

TEST_F(JobDocument, WaitingJobsKnowTheirPlace) {
  const std::string running = post_job(program, scene, kLongBake);
  while (member(job(running), "state") == "queued")
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const std::string first = post_job(program, scene, kLongBake),
                    second = post_job(program, scene, kLongBake);
  EXPECT_EQ(position(running), "null");
  EXPECT_EQ(position(first), "1");
  EXPECT_EQ(position(second), "2");
  const Answer raised = curl("-X PATCH -H 'Content-Type: application/json' -d '{\"priority\":1}' " +
                             program.url("/v1/jobs/" + second));
  EXPECT_EQ(member(raised.body, "queue_position"), "1");
  EXPECT_EQ(position(first), "2");
  const std::string list = ask(program.port(), "GET", "/v1/jobs?state=queued").body;
  EXPECT_NE(list.find("\"queue_position\":2"), std::string::npos) << list;
  EXPECT_EQ(ask(program.port(), "DELETE", "/v1/jobs/" + second + "?force=true").status, 204);
  EXPECT_EQ(position(first), "1");
  const Answer canceled = ask(program.port(), "POST", "/v1/jobs/" + first + "/cancel");
  EXPECT_EQ(member(canceled.body, "queue_position"), "null");
}

TEST_F(JobDocument, KeysNameWhatABakeGives) {
  const std::string settings = R"({"atlas":{"page_size":32}})";
  const std::string same = R"({"atlas":{"page_size":32},"solver":{"seed":1}})";
  const std::string other = R"({"atlas":{"page_size":32},"solver":{"seed":2}})";
  const auto small = write_small_scene(folder.path());
  const std::string a = job(post_job(program, small, settings)),
                    b = job(post_job(program, small, same)),
                    c = job(post_job(program, small, other)),
                    d = job(post_job(program, scene, settings));
  const auto result = [](const std::string& text) { return member(text, "result_key"); };
  const auto hash = [](const std::string& text) { return member(text, "settings_hash"); };
  EXPECT_EQ(result(a).size(), 64u);
  EXPECT_EQ(hash(a).size(), 64u);
  EXPECT_EQ(result(a), result(b)) << "a default may be said";
  EXPECT_EQ(hash(a), hash(b));
  EXPECT_NE(result(a), result(c));
  EXPECT_NE(hash(a), hash(c));
  EXPECT_NE(result(a), result(d));
  EXPECT_EQ(hash(a), hash(d));
}

}  // namespace
}  // namespace kiln::test
