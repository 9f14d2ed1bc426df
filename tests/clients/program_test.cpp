#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "tests/support/sanitizer.h"
#include "tests/support/temp_files.h"

/// The built program, as a user meets it.
namespace kiln {
namespace {

struct Outcome {
  int code = -1;
  std::string out, err;
};

class Program : public testing::Test {
 protected:
  test::TempFolder dir;

  /// Runs in the test's own folder, by the shell.
  Outcome run(const std::string& arguments, const std::string& variables = "") const {
    const std::string at = "'" + dir.path().string() + "'";
    const int status =
        std::system(("cd " + at + " && env -u LIGHTKILN_SERVER HOME=" + at + " " + variables +
                     " '" LIGHTKILN_BINARY "' " + arguments + " >out.txt 2>err.txt </dev/null")
                        .c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, test::read_bytes(dir.path() / "out.txt"),
            test::read_bytes(dir.path() / "err.txt")};
  }
};

TEST_F(Program, HelpAndVersion) {
  EXPECT_EQ(run("--help").code, 0);
  EXPECT_NE(run("--help").out.find("Examples:"), std::string::npos);
  for (const char* command : {"bake", "scene", "compare", "submit", "status", "watch", "cancel",
                              "fetch", "settings", "version"})
    EXPECT_EQ(run(std::string(command) + " --help").code, 0) << command;
  EXPECT_EQ(run("version").out, "lightkiln " LIGHTKILN_VERSION "\n");
  EXPECT_EQ(run("--version").out, "lightkiln " LIGHTKILN_VERSION "\n");
}

// What is stated is never exceeded; and where a bake takes more than a process does anyway, it is
// not far off either.
TEST_F(Program, BakesStateTheirMemoryBeforeTheyTakeIt) {
  if (test::kSlowdown != 1) GTEST_SKIP() << "a sanitizer takes memory of its own";
  struct Case {
    const char *scene, *settings;
  };
  for (const Case c :
       {Case{"cornell", "--set atlas.page_size=64"}, Case{"cornell", "--set atlas.page_size=512"},
        Case{"cornell", "--set atlas.page_size=512 --set solver.samples=256"},
        Case{"courtyard", "--set atlas.page_size=512 --set quality.preset=draft"},
        Case{"many_lights",
             "--set atlas.page_size=512 --set solver.samples=16 "
             "--set post.filter=false"},
        Case{"room_textured",
             "--set atlas.page_size=512 --set "
             "solver.method=path --set solver.samples=16"}}) {
    const std::string name = std::string(c.scene) + " " + c.settings;
    ASSERT_EQ(run(std::string("scene ") + c.scene + " -o s.glb").code, 0);
    const auto baked = run(std::string("bake s.glb -o out --json ") + c.settings);
    ASSERT_EQ(baked.code, 0) << baked.err;
    const auto statistics = nlohmann::json::parse(baked.out)["statistics"];
    const double stated = statistics["memory_estimate_bytes"],
                 used = statistics["peak_memory_bytes"];
    EXPECT_GE(stated, used) << name;
    constexpr double kAnyway = 64 << 20;
    EXPECT_LE(stated, 1.5 * std::max(used, kAnyway)) << name;
  }
}

TEST_F(Program, WrongUsageIsTwo) {
  for (const char* arguments :
       {"", "nonsense", "bake", "bake x.glb", "scene", "scene cornell", "scene nope -o x.glb",
        "bake missing.glb -o out", "compare a.exr b.exr", "watch", "watch job_1", "fetch job_1",
        "status --server ftp://x", "bake --threads many x -o y", "submit x.glb -o out"}) {
    const auto result = run(arguments);
    EXPECT_EQ(result.code, 2) << arguments << "\n" << result.err;
    EXPECT_FALSE(result.err.empty()) << arguments;
  }
}

TEST_F(Program, WrongSettingsNameTheirPlace) {
  dir.write("x.glb", "no scene");
  const auto result = run("bake x.glb -o out --set solver.bouncs=1 --set solver.samples=0");
  EXPECT_EQ(result.code, 2);
  EXPECT_NE(result.err.find("/solver/bouncs"), std::string::npos);
  EXPECT_NE(result.err.find("/solver/samples"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(dir.path() / "out"));
}

TEST_F(Program, AServiceThatIsNotThereIsOne) {
  const auto result = run("status --server http://127.0.0.1:1");
  EXPECT_EQ(result.code, 1);
  EXPECT_NE(result.err.find("server_unreachable"), std::string::npos);
  EXPECT_EQ(run("status", "LIGHTKILN_SERVER=http://127.0.0.1:1").code, 1);
}

TEST_F(Program, TheDefaultsAreASettingsFile) {
  const auto defaults = run("settings --defaults");
  ASSERT_EQ(defaults.code, 0);
  EXPECT_EQ(nlohmann::json::parse(defaults.out)["quality"]["preset"], "production");
  EXPECT_TRUE(nlohmann::json::parse(run("settings --schema").out).contains("properties"));
  EXPECT_NE(run("settings").out.find("atlas.page_size = 1024"), std::string::npos);
}

TEST_F(Program, BakesAndCompares) {
  ASSERT_EQ(run("scene cornell -o c.glb").code, 0);
  const std::string settings =
      " --set atlas.page_size=64 --set solver.samples=4 --set solver.direct_samples=4 "
      "--set solver.bounces=1";
  const auto first = run("bake c.glb -o a --json" + settings);
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_EQ(nlohmann::json::parse(first.out)["settings"]["solver"]["samples"], 4);
  EXPECT_EQ(first.err.find('\x1b'), std::string::npos);  // Not a terminal: plain lines.
  const auto second = run("bake c.glb -o b -q" + settings + " --set solver.seed=2");
  ASSERT_EQ(second.code, 0) << second.err;
  EXPECT_EQ(second.out + second.err, "");
  for (const char* name : {"page_00.exr", "page_00.png", "lit.glb", "manifest.json"})
    EXPECT_TRUE(std::filesystem::exists(dir.path() / "a" / name)) << name;
  EXPECT_EQ(run("compare a/page_00.exr a/page_00.exr --fail-above 0").code, 0);
  const auto other = run("compare a/page_00.exr b/page_00.exr --json --fail-above 1e-9");
  EXPECT_EQ(other.code, 1);  // Another seed gives other noise.
  EXPECT_GT(nlohmann::json::parse(other.out)["nrmse"].get<double>(), 1e-9);
}

TEST_F(Program, ADarkSceneSaysWhatToDo) {
  ASSERT_EQ(run("scene tilted_plane -o p.glb").code, 0);
  const auto result = run("bake p.glb -o out");
  EXPECT_EQ(result.code, 2);
  EXPECT_NE(result.err.find("[no_light]"), std::string::npos);
  EXPECT_NE(result.err.find("sky.radiance"), std::string::npos);
}

}  // namespace
}  // namespace kiln
