#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <iterator>

#include "tests/http/event_stream.h"
#include "tests/http/program.h"

/// The commands that talk to a service, against a real one.
namespace kiln::test {
namespace {

struct Outcome {
  int code = -1;
  std::string text;
};

class Commands : public testing::Test {
 protected:
  TempFolder folder;
  Program program{folder.path() / "data"};
  const std::string scene = write_small_scene(folder.path()).string();

  Outcome run(const std::string& arguments) const {
    const auto output = folder.path() / "output";
    const std::string command = std::string(LIGHTKILN_BINARY) + " " + arguments + " --server " +
                                program.url() + " >" + output.string() + " 2>&1 </dev/null";
    const int status = std::system(command.c_str());
    std::ifstream in(output, std::ios::binary);
    std::string text(std::istreambuf_iterator<char>(in), {});
    while (text.ends_with('\n')) text.pop_back();
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, std::move(text)};
  }
  std::string digest(const std::string& path) const {
    return proto::digest_file(folder.path() / path).value().sha256;
  }
};

TEST_F(Commands, SubmitWatchStatusAndFetch) {
  const std::string out = (folder.path() / "a").string(), again = (folder.path() / "b").string();
  const std::string set = " --set solver.samples=16";
  const Outcome waited = run("submit " + scene + set + " --wait -o " + out);
  ASSERT_EQ(waited.code, 0) << waited.text;
  const Outcome submitted = run("submit " + scene + set);
  ASSERT_EQ(submitted.code, 0) << submitted.text;
  const std::string id = submitted.text;
  EXPECT_EQ(run("watch " + id).code, 0);
  const Outcome status = run("status " + id);
  EXPECT_EQ(status.code, 0);
  EXPECT_NE(status.text.find("succeeded"), std::string::npos) << status.text;
  EXPECT_NE(run("status").text.find(id), std::string::npos);
  EXPECT_EQ(run("fetch " + id + " -o " + again).code, 0);
  for (const char* name : {"/page_00.exr", "/page_00.png", "/lit.glb"})
    EXPECT_EQ(digest(std::string("a") + name), digest(std::string("b") + name)) << name;
}

TEST_F(Commands, OptionsRetryAndCancelWithAResult) {
  const std::string set = " --set solver.samples=16";
  EXPECT_EQ(run("submit " + scene + set + " --wait -q").code, 0);
  const std::string twin = run("submit " + scene + set + " --label team=art --priority 5").text;
  EXPECT_EQ(member(ask(program.port(), "GET", "/v1/jobs/" + twin).body, "cached"), "true");
  EXPECT_NE(ask(program.port(), "GET", "/v1/jobs?label=team:art").body.find(twin),
            std::string::npos);
  EXPECT_EQ(run("retry " + twin).code, 1) << "it succeeded";
  const std::string baked = run("submit " + scene + set + " --bake-again --ttl-seconds 60").text;
  const Answer job = ask(program.port(), "GET", "/v1/jobs/" + baked + "?wait=60");
  EXPECT_EQ(member(job.body, "cached"), "false");
  EXPECT_EQ(member(job.body, "ttl_seconds"), "60");
  EXPECT_EQ(run("submit " + scene + " --label team").code, 2);

  const auto cornell = write_scene(folder.path(), "cornell").string();
  const std::string id = run("submit " + cornell + " --set solver.method=path --set " +
                             "solver.samples=4096 --set atlas.page_size=64")
                             .text;
  EventStream stream(program.port(), id);
  ASSERT_TRUE(stream.wait_for("pass.completed"));
  EXPECT_EQ(run("cancel --keep " + id).text, "canceling");
  ASSERT_TRUE(stream.wait_for("job.end"));
  EXPECT_EQ(run("fetch " + id + " -o " + (folder.path() / "kept").string()).code, 0);
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "kept" / "page_00.exr"));
  EXPECT_EQ(run("retry " + id).text, "queued");
  EXPECT_TRUE(program.logged("\"event\":\"job.resumed\"")) << "from the pass that was kept";
  EXPECT_EQ(run("cancel " + id).code, 0);
}

TEST_F(Commands, CancelEndsAJobThatWatchCallsFailed) {
  const auto cornell = write_scene(folder.path(), "cornell").string();
  const Outcome submitted = run("submit " + cornell + " --set solver.samples=4096");
  ASSERT_EQ(submitted.code, 0) << submitted.text;
  const std::string id = submitted.text;
  EXPECT_EQ(run("cancel " + id).code, 0);
  const Outcome watched = run("watch " + id);
  EXPECT_EQ(watched.code, 1);
  EXPECT_NE(watched.text.find("canceled"), std::string::npos) << watched.text;
  EXPECT_EQ(run("cancel " + id).text, "canceled");
  EXPECT_NE(run("fetch " + id + " -o " + (folder.path() / "none").string()).code, 0);
}

TEST_F(Commands, WhatTheServiceRefusesIsWrongInput) {
  std::ofstream(folder.path() / "cut.glb") << "glTF";
  const Outcome refused = run("submit " + (folder.path() / "cut.glb").string());
  EXPECT_EQ(refused.code, 2);
  EXPECT_NE(refused.text.find("[invalid_scene]"), std::string::npos) << refused.text;
  const Outcome unknown = run("status job_" + std::string(26, '0'));
  EXPECT_EQ(unknown.code, 2);
  EXPECT_NE(unknown.text.find("[not_found]"), std::string::npos) << unknown.text;
}

}  // namespace
}  // namespace kiln::test
