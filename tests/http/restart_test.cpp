#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <numeric>
#include <thread>

#include "tests/http/event_stream.h"
#include "tests/http/program.h"

/// The built program under signals.
namespace kiln::test {
namespace {

constexpr const char* kShortBake =
    R"({"atlas":{"page_size":256},"solver":{"samples":128,"direct_samples":32}})";

class Signals : public testing::Test {
 protected:
  TempFolder folder;
  const std::filesystem::path data = folder.path() / "data";
  const std::filesystem::path scene = write_scene(folder.path(), "cornell");

  static Answer wait_for(const Program& program, const std::string& id) {
    return ask(program.port(), "GET", "/v1/jobs/" + id + "?wait=60");
  }
  static std::string exr(const Program& program, const std::string& id) {
    const Answer answer = ask(program.port(), "GET", "/v1/jobs/" + id + "/results/page_00.exr");
    EXPECT_EQ(answer.status, 200);
    return answer.body;
  }
};

TEST_F(Signals, AKilledBakeGoesOnAfterItsLastPassWithTheSameBytes) {
  std::string id;
  std::vector<std::uint64_t> ids;
  std::vector<std::string> passes;
  const auto take = [&](const EventStream& stream) {
    const auto more = stream.ids();
    ids.insert(ids.end(), more.begin(), more.end());
    for (const auto& event : stream.events())
      if (event.type == "pass.completed") passes.push_back(member(event.data, "index"));
  };
  constexpr int kKills = 4;
  for (int kill = 0; kill < kKills; ++kill) {  // more often than a job without progress may be
    Program killed(data, {"--checkpoint-percent", "100"});  // so that a kill finds many passes
    if (kill == 0) id = post_job(killed, scene, kShortBake);
    EventStream stream(killed.port(), id, ids.empty() ? "" : std::to_string(ids.back()));
    ASSERT_TRUE(stream.wait_for("pass.completed"));
    killed.signal(SIGKILL);
    EXPECT_EQ(killed.wait_exit(), -SIGKILL);
    stream.wait_end(std::chrono::seconds(1));  // what was on its way
    take(stream);
  }
  EXPECT_TRUE(std::filesystem::exists(data / "jobs" / id / "checkpoints" / "state.bin"));
  Program program(data);
  EventStream rest(program.port(), id, std::to_string(ids.back()));
  ASSERT_TRUE(rest.wait_for("job.end"));
  take(rest);
  EXPECT_TRUE(program.logged("\"event\":\"job.resumed\""));
  std::vector<std::uint64_t> all(ids.back());
  std::iota(all.begin(), all.end(), 1u);
  EXPECT_EQ(ids, all) << "over all processes, without holes";
  const Answer job = wait_for(program, id);
  EXPECT_EQ(member(job.body, "state"), "succeeded") << job.body;
  EXPECT_EQ(member(job.body, "attempt"), std::to_string(kKills + 1));
  EXPECT_FALSE(std::filesystem::exists(data / "jobs" / id / "checkpoints"));
  ASSERT_GT(passes.size(), std::size_t{kKills});
  for (std::size_t i = 1; i < passes.size(); ++i)
    EXPECT_LT(std::stoi(passes[i - 1]), std::stoi(passes[i])) << "a pass was made again";
  const std::string undisturbed = post_job(program, scene, kShortBake);
  EXPECT_EQ(member(wait_for(program, undisturbed).body, "state"), "succeeded");
  const std::string bytes = exr(program, id);
  EXPECT_GT(bytes.size(), 10'000u);
  EXPECT_TRUE(bytes == exr(program, undisturbed));
}

TEST_F(Signals, AKilledBakeGoesOnInTheMiddleOfAPass) {
  std::string id;
  {
    Program killed(data, {"--checkpoint-seconds", "1", "--threads", "1"});
    id = post_job(killed, scene, kLongBake);
    const auto part = data / "jobs" / id / "checkpoints" / "part_1.bin";
    const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!std::filesystem::exists(part) && std::chrono::steady_clock::now() < late)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    killed.signal(SIGKILL);
    EXPECT_EQ(killed.wait_exit(), -SIGKILL);
    EXPECT_TRUE(std::filesystem::exists(part));
  }
  Program program(data);
  EXPECT_TRUE(program.logged("\"event\":\"job.resumed_within\""));
  const Answer log = ask(program.port(), "GET", "/v1/jobs/" + id + "/results/log.txt");
  EXPECT_NE(log.body.find("% are there from an earlier attempt."), std::string::npos) << log.body;
  EXPECT_EQ(ask(program.port(), "DELETE", "/v1/jobs/" + id + "?force=true").status, 204);
}

TEST_F(Signals, AnIdleServiceEndsAtOnce) {
  Program program(data);
  const auto began = std::chrono::steady_clock::now();
  program.signal(SIGTERM);
  EXPECT_EQ(program.wait_exit(), 0);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(2));
}

TEST_F(Signals, ARunningBakeIsFinishedWhileDraining) {
  Program program(data);
  const std::string id = post_job(program, scene, kShortBake);
  EventStream stream(program.port(), id);
  ASSERT_TRUE(stream.wait_for("job.progress"));
  const std::string waiting = post_job(program, scene, kShortBake);
  program.signal(SIGTERM);
  ASSERT_TRUE(stream.wait_for("server.draining"));
  EXPECT_EQ(ask(program.port(), "POST", "/v1/jobs").status, 503);
  EXPECT_TRUE(stream.wait_for("job.end"));
  EXPECT_NE(stream.events().back().data.find("\"succeeded\""), std::string::npos);
  EXPECT_EQ(program.wait_exit(), 0) << program.log();
}

TEST_F(Signals, ABakeBeyondTheDrainDeadlineGoesBackToTheQueue) {
  std::string id;
  {
    Program program(data, {"--drain-seconds", "1"});
    id = post_job(program, scene, kLongBake);
    EventStream stream(program.port(), id);
    ASSERT_TRUE(stream.wait_for("job.progress"));
    const auto began = std::chrono::steady_clock::now();
    program.signal(SIGTERM);
    EXPECT_TRUE(stream.wait_for("server.draining"));
    EXPECT_TRUE(stream.wait_end());
    EXPECT_EQ(stream.count("job.end"), 0u);
    EXPECT_EQ(program.wait_exit(), 0) << program.log();
    const auto time = std::chrono::steady_clock::now() - began;
    EXPECT_GE(time, std::chrono::seconds(1));
    EXPECT_LT(time, std::chrono::seconds(4));
  }
  Program program(data);
  const Answer job = ask(program.port(), "GET", "/v1/jobs/" + id);
  EXPECT_EQ(member(job.body, "attempt"), "2") << job.body;
  EXPECT_EQ(ask(program.port(), "DELETE", "/v1/jobs/" + id + "?force=true").status, 204);
}

TEST_F(Signals, ASecondSignalForces) {
  Program program(data);
  const std::string id = post_job(program, scene, kLongBake);
  EventStream stream(program.port(), id);
  ASSERT_TRUE(stream.wait_for("job.progress"));
  program.signal(SIGTERM);
  ASSERT_TRUE(program.logged("\"event\":\"draining\""));
  const auto began = std::chrono::steady_clock::now();
  program.signal(SIGINT);
  EXPECT_EQ(program.wait_exit(), 2);
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(4));
}

TEST_F(Signals, AFolderBelongsToOneServiceAtATime) {
  Program program(data);
  const std::string command = std::string(LIGHTKILN_BINARY) + " serve --port 0 --admin-port 0" +
                              " --data " + data.string() + " 2>" +
                              (folder.path() / "error").string();
  const int status = std::system(command.c_str());
  EXPECT_EQ(WEXITSTATUS(status), 1);
  EXPECT_EQ(ask(program.port(), "GET", "/v1/jobs").status, 200);
}

}  // namespace
}  // namespace kiln::test
