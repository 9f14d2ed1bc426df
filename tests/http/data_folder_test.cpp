// The program opens the data folder of an earlier version that was killed at work, and finishes its
// jobs. tests/data/make_data_folder makes such a folder and says what is in it.
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>

#include "proto/sha256.h"
#include "tests/http/program.h"

namespace kiln::test {
namespace {

using nlohmann::json;

class DataFolder : public testing::TestWithParam<const char*> {
 protected:
  test::TempFolder folder_;

  void SetUp() override {
    const std::string archive =
        std::string(LIGHTKILN_SOURCE_DIR "/tests/data/data_folder_") + GetParam() + ".tar.gz";
    const std::string unpack =
        "tar --no-same-owner -xzf '" + archive + "' -C '" + folder_.path().string() + "'";
    ASSERT_EQ(std::system(unpack.c_str()), 0);
  }
};

/// Lists the jobs by their label "is".
std::map<std::string, json> jobs(const Program& program) {
  std::map<std::string, json> jobs;
  const Answer answer = ask(program.port(), "GET", "/v1/jobs");
  EXPECT_EQ(answer.status, 200) << answer.body;
  const json list = json::parse(answer.body);
  for (const json& job : list.at("items")) jobs[job.at("labels").at("is")] = job;
  return jobs;
}

/// Reads all results of a job and compares them with the sizes and digests that it lists. Returns
/// their names.
std::vector<std::string> results(const Program& program, const json& job) {
  const std::string path = "/v1/jobs/" + job.at("id").get<std::string>() + "/results";
  const Answer manifest = ask(program.port(), "GET", path);
  EXPECT_EQ(manifest.status, 200) << manifest.body;
  const json listed = json::parse(manifest.body);
  std::vector<std::string> names;
  for (const json& file : listed.at("files")) {
    names.push_back(file.at("name"));
    const Answer answer = ask(program.port(), "GET", path + "/" + names.back());
    EXPECT_EQ(answer.status, 200) << names.back();
    EXPECT_EQ(answer.body.size(), file.at("bytes")) << names.back();
    EXPECT_EQ(proto::sha256_hex(answer.body), file.at("sha256")) << names.back();
  }
  return names;
}

/// Waits for the job and returns it.
json end_of(const Program& program, const json& job) {
  const std::string path = "/v1/jobs/" + job.at("id").get<std::string>();
  return json::parse(ask(program.port(), "GET", path + "?wait=60").body);
}

std::string exr(const Program& program, const json& job) {
  const std::string path = "/v1/jobs/" + job.at("id").get<std::string>();
  return ask(program.port(), "GET", path + "/results/page_00.exr").body;
}

/// Posts the same job again; it is baked even though there is one like it.
json post_again(const Program& program, const json& job) {
  const json body = {{"scene", "sha256:" + job.at("scene").at("sha256").get<std::string>()},
                     {"settings", job.at("settings")},
                     {"dedupe", false}};
  const Answer answer =
      ask(program.port(), "POST", "/v1/jobs", {"Content-Type: application/json"}, body.dump());
  EXPECT_EQ(answer.status, 202) << answer.body;
  return json::parse(answer.body);
}

TEST_P(DataFolder, OfAnEarlierVersionIsOpenedAndBroughtToItsEnd) {
  const std::vector<std::string> all{"page_00.exr", "page_00.png", "lit.glb", "log.txt",
                                     "manifest.json"};
  Program program(folder_.path());
  auto before = jobs(program);
  ASSERT_EQ(before.size(), 5u);
  EXPECT_EQ(before["done"].at("state"), "succeeded");
  EXPECT_EQ(before["done"].at("attempt"), 1);
  EXPECT_EQ(results(program, before["done"]), all);
  EXPECT_EQ(before["canceled"].at("state"), "canceled");

  for (const char* killed : {"gather", "path"}) {
    const json job = end_of(program, before[killed]);
    EXPECT_EQ(job.at("state"), "succeeded") << job;
    EXPECT_EQ(job.at("attempt"), 2) << job;
    EXPECT_EQ(results(program, job), all);
    const auto folder = folder_.path() / "jobs" / job.at("id").get<std::string>();
    EXPECT_FALSE(std::filesystem::exists(folder / "checkpoints"));
    // The light does not depend on whether the checkpoints could be used.
    const json undisturbed = end_of(program, post_again(program, job));
    EXPECT_EQ(undisturbed.at("state"), "succeeded") << undisturbed;
    EXPECT_TRUE(exr(program, job) == exr(program, undisturbed)) << killed;
  }
  const json queued = end_of(program, before["queued"]);
  EXPECT_EQ(queued.at("state"), "succeeded") << queued;
  EXPECT_EQ(queued.at("attempt"), 1) << queued;
  EXPECT_EQ(results(program, queued), all);
  EXPECT_EQ(end_of(program, before["canceled"]).at("state"), "canceled");
}

INSTANTIATE_TEST_SUITE_P(Versions, DataFolder, testing::Values("0_2_0"),
                         [](const auto& version) { return "Of" + std::string(version.param); });

}  // namespace
}  // namespace kiln::test
