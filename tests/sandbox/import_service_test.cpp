// The process that decodes uploads, seen from a running service.
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/http/program.h"
#include "tests/sandbox/slow_scene.h"
#include "tests/support/temp_files.h"

namespace kiln::test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

/// The import process of a running service, once it decodes.
pid_t import_process_of(const Program& program) {
  const fs::path tasks = "/proc/" + std::to_string(program.pid()) + "/task";
  for (int i = 0; i < 20'000; ++i, std::this_thread::sleep_for(1ms)) {
    std::error_code gone;
    for (fs::directory_iterator at(tasks, gone), end; !gone && at != end; at.increment(gone)) {
      std::ifstream children(at->path() / "children");
      for (pid_t pid = 0; children >> pid;)
        if (is_confined(pid)) return pid;
    }
  }
  return -1;
}

/// The job's problem, once it is over.
std::string end_of(const Program& program, const std::string& id) {
  return curl(program.url("/v1/jobs/" + id + "?wait=60")).body;
}

TEST(ImportOfTheService, ItsDeathFailsOneJobOfTheService) {
  const TempFolder folder;
  Program program(folder.path() / "data");
  EXPECT_TRUE(program.logged("import.confined")) << program.log();
  const auto slow = folder.write("slow.glb", textured_glb(large_png(6000)));
  const std::string small = R"({"atlas":{"page_size":64}})";
  const std::string id = post_job(program, slow, small);
  const pid_t pid = import_process_of(program);
  ASSERT_GT(pid, 0) << program.log();
  ::kill(pid, SIGSTOP);  // so that the other job meets it
  const std::string other = post_job(program, write_small_scene(folder.path()), small);
  EXPECT_EQ(member(end_of(program, other), "state"), "succeeded");
  ::kill(pid, SIGKILL);
  const std::string job = end_of(program, id);
  EXPECT_EQ(member(job, "state"), "failed") << job;
  EXPECT_EQ(member(member(job, "error"), "code"), "import_crashed") << job;
  EXPECT_TRUE(program.logged("import.failed"));
  EXPECT_EQ(curl("-X POST " + program.url("/v1/jobs/" + id + "/retry")).status, 202);
  EXPECT_EQ(member(end_of(program, id), "state"), "succeeded") << "nobody kills it this time";
}

// One process checks a scene and imports it, another writes lit.glb.
TEST(ImportOfTheService, AJobHasTwoProcesses) {
  const TempFolder folder;
  Program program(folder.path() / "data", {"--log-level", "debug"});
  const std::string settings = R"({"atlas":{"page_size":64}})";
  const auto bake = [&](const std::string& name) {
    const auto scene = write_scene(folder.path(), name);
    EXPECT_EQ(member(end_of(program, post_job(program, scene, settings)), "state"), "succeeded");
  };
  const auto processes = [&] {
    const std::string log = program.log();
    int count = 0;
    for (auto at = log.find("import.process"); at != log.npos;
         at = log.find("import.process", at + 1))
      ++count;
    return count;
  };
  bake("room_textured");  // its import waits until processes are forked from the zygote
  const int before = processes();
  ASSERT_GT(before, 0) << program.log();
  bake("cornell");
  EXPECT_EQ(processes() - before, 2) << program.log();
}

// Only the zygote and its copies have the image module open.
TEST(ImportOfTheService, TheServiceNeverOpensTheImageModule) {
  const TempFolder folder;
  Program program(folder.path() / "data");
  const auto scene = write_scene(folder.path(), "room_textured");
  const std::string id = post_job(program, scene, R"({"atlas":{"page_size":64}})");
  EXPECT_EQ(member(end_of(program, id), "state"), "succeeded");
  // A finished page is decoded, and encoded anew.
  const auto preview = curl(program.url("/v1/jobs/" + id + "/preview?exposure=3"));
  EXPECT_EQ(preview.status, 200) << preview.body;
  EXPECT_TRUE(preview.body.starts_with("\x89PNG"));
  const std::string maps = process_file(program.pid(), "maps");
  EXPECT_NE(maps.find("libc.so"), maps.npos);
  EXPECT_EQ(maps.find("OpenImageIO"), maps.npos);
  EXPECT_EQ(maps.find("liblightkiln-image"), maps.npos);
}

TEST(ImportOfTheService, GoesWithTheService) {
  const TempFolder folder;
  Program program(folder.path() / "data");
  post_job(program, folder.write("slow.glb", slow_glb()));
  const pid_t pid = import_process_of(program);
  ASSERT_GT(pid, 0);
  ::kill(pid, SIGSTOP);
  program.signal(SIGKILL);
  program.wait_exit();
  for (int i = 0; i < 5000 && ::kill(pid, 0) == 0 && status_of(pid, "State")[0] != 'Z'; ++i)
    std::this_thread::sleep_for(1ms);
  EXPECT_TRUE(::kill(pid, 0) != 0 || status_of(pid, "State")[0] == 'Z');
}

TEST(ImportOfTheService, LimitsOfTheServiceAreToldAndNamed) {
  const TempFolder folder;
  Program program(folder.path() / "data",
                  {"--max-scene-triangles", "5", "--max-scene-json-depth", "9", "--import-seconds",
                   "77", "--max-image-pixels", "1000", "--memory-budget-bytes", "1GiB",
                   "--max-import-processes", "2"});
  const std::string limits = member(curl(program.url("/v1/capabilities")).body, "limits");
  EXPECT_EQ(member(limits, "triangles"), "5");
  EXPECT_EQ(member(limits, "vertices"), "15");
  EXPECT_EQ(member(limits, "scene_json_depth"), "9");
  EXPECT_EQ(member(limits, "import_seconds"), "77");
  EXPECT_EQ(member(limits, "image_pixels"), "1000");
  EXPECT_EQ(member(limits, "memory_bytes"), std::to_string(3ull << 28)) << "that bakes may have";
  EXPECT_EQ(member(limits, "import_memory_bytes"), std::to_string(896ull << 20))
      << "what bakes may have, and what is set aside for one import";
  const auto refused =
      curl(job_form(write_scene(folder.path(), "cornell")) + program.url("/v1/jobs"));
  EXPECT_EQ(refused.status, 422);
  EXPECT_EQ(member(refused.body, "code"), "limit_exceeded");
  EXPECT_NE(member(refused.body, "detail").find("`triangles`"), std::string::npos) << refused.body;
  const std::string deep = R"({"asset":{"version":"2.0","extras":[[[[[[[[[[]]]]]]]]]]}})";
  const auto nested = curl(job_form(folder.write("deep.gltf", deep)) + program.url("/v1/jobs"));
  EXPECT_NE(member(nested.body, "detail").find("`scene_json_depth`"), std::string::npos)
      << nested.body;
  // Images are decoded by the job.
  const auto large = folder.write("large.glb", textured_glb(large_png(64)));
  const std::string job = end_of(program, post_job(program, large));
  EXPECT_NE(member(job, "error").find("`image_pixels`"), std::string::npos) << job;
}

}  // namespace
}  // namespace kiln::test
