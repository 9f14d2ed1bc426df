#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

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
  for (const char* command : {"bake", "scene", "compare", "view", "submit", "status", "watch",
                              "cancel", "fetch", "settings", "version"})
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
             "solver.method=path --set solver.samples=16"},
        Case{"cornell",
             "--set atlas.page_size=192 --set solver.method=links --set solver.bounces=1"},
        Case{"cornell",
             "--set atlas.page_size=512 --set solver.method=directional --set solver.samples=16"},
        Case{"cornell",
             "--set atlas.page_size=512 --set solver.method=radiosity_map --set "
             "solver.samples=32"},
        Case{"cornell",
             "--set atlas.page_size=512 --set solver.method=pairwise --set "
             "solver.undersampling=monte_carlo --set solver.window=32 --set solver.bounces=1"},
        Case{"cornell", "--set atlas.page_size=96 --set report.against=matrix"},
        Case{"courtyard",
             "--set atlas.page_size=512 --set solver.samples=16 --set report.against=path "
             "--set report.samples=2"}}) {
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

TEST_F(Program, ComparesFoldersAndLayersAndWritesPictures) {
  ASSERT_EQ(run("scene cornell -o s.glb").code, 0);
  for (const char* seed : {"1", "2", "3"}) {
    const auto baked = run("bake s.glb -q -o " + std::string(seed) +
                           " --set atlas.page_size=64 --set solver.samples=4 --set "
                           "solver.direct_samples=4 --set solver.bounces=1 --set "
                           "'output.layers=[\"irradiance\",\"direct\"]' --set solver.seed=" +
                           seed);
    ASSERT_EQ(baked.code, 0) << baked.err;
  }
  const auto figures = [&](const std::string& arguments) {
    const auto result = run("compare --json " + arguments);
    EXPECT_EQ(result.code, 0) << result.err;
    return nlohmann::json::parse(result.out, nullptr, false);
  };
  const auto all = figures("1 2 --diff e.png --diff-scale 4 --contours c.png --histogram h.csv");
  EXPECT_EQ(all["pages"][0]["page"], "page_00");
  EXPECT_EQ(all["pages"][0]["nrmse"], all["nrmse"]);
  EXPECT_EQ(all["pixels"], 64 * 64);
  EXPECT_DOUBLE_EQ(all["diff_full"].get<double>(), all["scale"].get<double>() / 4);
  for (const char* name : {"e.png", "c.png"})
    EXPECT_EQ(test::read_bytes(dir.path() / name).substr(1, 3), "PNG") << name;
  const std::string rows = test::read_bytes(dir.path() / "h.csv");
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 65);

  const auto direct = figures("1/page_00.exr 2/page_00.exr --layer direct");
  EXPECT_LT(direct["mean_reference"], all["mean_reference"]);
  EXPECT_EQ(figures("1 2 --layer irradiance"), figures("1 2"));
  EXPECT_NEAR(figures("1 1 --factor pi")["bias"].get<double>(), 2.14159265, 1e-6);
  EXPECT_EQ(figures("1 2 --scale 1e6")["dfpr"], all["dfpr"]);
  EXPECT_LT(figures("1 2 --scale 1e6")["dfpr_all"], all["dfpr_all"]);
  const auto unbiased = figures("1 2 --second-reference 3")["unbiased"];
  // Three bakes of one kind: each has the noise that two of them tell of a third.
  EXPECT_NEAR(unbiased["nrmse"].get<double>() / unbiased["noise"].get<double>(), 1, 0.3);
  EXPECT_NE(run("compare 1 2 --second-reference 3").out.find("unbiased"), std::string::npos);
}

TEST_F(Program, ReportsAgainstAFileThatLiesBesideTheScene) {
  ASSERT_EQ(run("scene cornell -o s.glb").code, 0);
  const std::string bake =
      "bake s.glb -q --set atlas.page_size=64 --set solver.samples=4 --set solver.direct_samples=4 "
      "--set solver.bounces=1 -o ";
  ASSERT_EQ(run(bake + "a").code, 0);
  std::filesystem::copy_file(dir.path() / "a/page_00.exr", dir.path() / "ref.exr");
  const auto baked = run(bake + "b --set solver.seed=2 --set report.against=ref.exr");
  ASSERT_EQ(baked.code, 0) << baked.err;
  const auto report = nlohmann::json::parse(test::read_bytes(dir.path() / "b/report.json"));
  const auto figures = nlohmann::json::parse(run("compare --json a b").out);
  // The page that compare reads has lost some bits to half floats.
  EXPECT_NEAR(report["figures"]["nrmse"].get<double>() / figures["nrmse"].get<double>(), 1, 1e-3);
  const auto missing = run(bake + "c --set report.against=none.exr");
  EXPECT_EQ(missing.code, 2);
  EXPECT_NE(missing.err.find("/report/against"), std::string::npos) << missing.err;
}

TEST_F(Program, KeepsPassesAndShowsHowTheyConverge) {
  ASSERT_EQ(run("scene cornell -o s.glb").code, 0);
  const std::string bake =
      "bake s.glb -q --set atlas.page_size=64 --set solver.samples=16 --set "
      "solver.direct_samples=16 --set solver.bounces=3 --set post.filter=false --keep-passes p -o "
      "a";
  const auto baked = run(bake);
  ASSERT_EQ(baked.code, 0) << baked.err;
  const auto result = run("compare a p --contact-sheet sheet.png");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(test::read_bytes(dir.path() / "sheet.png").substr(1, 3), "PNG");
  std::vector<double> errors;
  std::istringstream rows(result.out);
  std::string row;
  std::getline(rows, row);
  EXPECT_EQ(row.substr(0, 34), "pass,name,seconds,rays,nrmse,rel_r");
  while (std::getline(rows, row)) {
    std::istringstream cells(row);
    std::string cell;
    for (int i = 0; i < 5; ++i) std::getline(cells, cell, ',');
    errors.push_back(std::stod(cell));
  }
  // Direct light lacks all that bounces; the last pass is the result, but for the file's half
  // floats.
  ASSERT_GE(errors.size(), 4u);
  EXPECT_GT(errors.front(), 0.1);
  EXPECT_LT(errors.back(), 1e-3);
  EXPECT_EQ(run("compare a p --passes c.csv --fail-above 1e-3").out, "");
  EXPECT_EQ(test::read_bytes(dir.path() / "c.csv"), result.out);
  EXPECT_EQ(run(bake).code, 2) << "the passes of another bake lie there";
  EXPECT_EQ(run("compare a a --passes c.csv").code, 2);
}

TEST_F(Program, ComparisonsThatCantBeSayWhy) {
  ASSERT_EQ(run("scene cornell -o s.glb").code, 0);
  for (const char* size : {"32", "64"})
    ASSERT_EQ(run("bake s.glb -q -o " + std::string(size) +
                  " --set solver.samples=1 --set solver.direct_samples=1 --set solver.bounces=0 "
                  "--set atlas.page_size=" +
                  size)
                  .code,
              0);
  std::filesystem::create_directories(dir.path() / "empty");
  dir.write("text.exr", "no picture");
  struct Case {
    const char *arguments, *says;
    int code;
  };
  for (const Case c :
       {Case{"32/page_00.exr 64/page_00.exr", "32x32 and 64/page_00.exr is 64x64", 2},
        Case{"32 32/page_00.exr", "32 is a folder, and 32/page_00.exr is a file", 2},
        Case{"32 empty", "empty has no page_00.exr", 2},
        Case{"empty 32", "empty has no page_NN", 2},
        Case{"32/page_00.exr text.exr", "text.exr can't be compared", 2},
        Case{"32 32 --layer raw", "no layer 'raw'; its layers are irradiance", 2},
        Case{"32 32 --scale 0", "--scale", 2}, Case{"32 32 --factor tau", "--factor", 2},
        Case{"32 32 --diff none/e.png", "[io_error]", 1}}) {
    const auto result = run(std::string("compare ") + c.arguments);
    EXPECT_EQ(result.code, c.code) << c.arguments;
    EXPECT_NE(result.err.find(c.says), std::string::npos) << c.arguments << "\n" << result.err;
  }
}

TEST_F(Program, DrawsWhatWasBaked) {
  ASSERT_EQ(run("scene cornell -o c.glb").code, 0);
  const auto baked =
      run("bake c.glb -o out -q --set atlas.page_size=64 --set solver.samples=4 --set "
          "solver.bounces=1 --set 'output.layers=[\"irradiance\",\"normal\"]'");
  ASSERT_EQ(baked.code, 0) << baked.err;
  EXPECT_TRUE(std::filesystem::exists(dir.path() / "out/page_00.normal.png"));
  const auto light = run("view out -o light.png --size 64x48");
  ASSERT_EQ(light.code, 0) << light.err;
  EXPECT_NE(light.out.find("light.png: 64x48, irradiance, exposure "), std::string::npos)
      << light.out;
  EXPECT_TRUE(test::read_bytes(dir.path() / "light.png").starts_with("\x89PNG"));
  for (const char* flags :
       {"--layer normal --nearest", "--shaded", "--ortho --camera 0,9,0:0,0,0:3", "--threads 1",
        "--scene c.glb --exposure 0.1"}) {
    const auto drawn = run(std::string("view out -o other.png --size 32x32 ") + flags);
    EXPECT_EQ(drawn.code, 0) << flags << "\n" << drawn.err;
  }
  for (const auto& [flags, words] :
       std::vector<std::pair<std::string, std::string>>{{"--layer normals", "texel_checker"},
                                                        {"--layer area", "output.layers"},
                                                        {"--camera door", "x,y,z:tx,ty,tz"},
                                                        {"--camera 1,2:3,4,5", "x,y,z:tx,ty,tz"},
                                                        {"--size 5000x5", "4096"},
                                                        {"--layer normal --shaded", "irradiance"},
                                                        {"--exposure -1", "over 0"},
                                                        {"--nearest --bilinear", "excludes"}}) {
    const auto wrong = run("view out -o wrong.png " + flags);
    EXPECT_EQ(wrong.code, 2) << flags << "\n" << wrong.err;
    EXPECT_NE(wrong.err.find(words), std::string::npos) << flags << "\n" << wrong.err;
  }
  EXPECT_FALSE(std::filesystem::exists(dir.path() / "wrong.png"));
  const auto none = run("view nothing -o wrong.png");
  EXPECT_EQ(none.code, 2);
  EXPECT_NE(none.err.find("manifest.json"), std::string::npos) << none.err;
}

TEST_F(Program, TellsWhichPairsSeeEachOther) {
  ASSERT_EQ(run("scene cornell -o c.glb").code, 0);
  // The first pair of the box's inside sees each other, the second has a wall between.
  const float inside[6] = {0, 4.5f, 0.3f, 0.1f, 4.5f, 0.2f}, wall[6] = {0, 4.5f, 0, 50, 4.5f, 0};
  std::string pairs;
  for (int i = 0; i < 1'000'002; ++i)  // more than are traced at a time
    pairs.append(reinterpret_cast<const char*>(i % 3 == 2 ? wall : inside), sizeof inside);
  dir.write("p.bin", pairs);
  const auto plain = run("visibility c.glb --pairs p.bin -o bits.bin --threads 2");
  ASSERT_EQ(plain.code, 0) << plain.err;
  EXPECT_TRUE(plain.out.starts_with("bits.bin: 1000002 pairs, 666668 see each other, "))
      << plain.out;
  const std::string bits = test::read_bytes(dir.path() / "bits.bin");
  ASSERT_EQ(bits.size(), 125'001u);
  EXPECT_EQ(bits.substr(0, 3), "\xdb\xb6\x6d");
  EXPECT_EQ(bits.back(), '\x01');

  const std::string at = "cd '" + dir.path().string() + "' && '" LIGHTKILN_BINARY "' visibility ";
  EXPECT_EQ(std::system((at + "c.glb --pairs - -o - --json <p.bin >same.bin 2>err.txt").c_str()),
            0);
  EXPECT_TRUE(test::read_bytes(dir.path() / "same.bin") == bits);
  const auto figures = nlohmann::json::parse(test::read_bytes(dir.path() / "err.txt"));
  EXPECT_EQ(figures["pairs"], 1'000'002);
  EXPECT_EQ(figures["visible"], 666'668);
  EXPECT_GT(figures["rays_per_second"], 0);

  dir.write("cut.bin", pairs.substr(0, pairs.size() - 3));
  std::fill_n(pairs.begin() + 24 * 1'000'001 + 8, 4, '\xff');
  dir.write("nan.bin", pairs);
  for (const auto& [flags, words] : std::vector<std::pair<std::string, std::string>>{
           {"c.glb --pairs cut.bin", "no multiple of 24"},
           {"c.glb --pairs nan.bin", "number 2 of pair 1000001"},
           {"c.glb --pairs none.bin", "none.bin"},
           {"none.glb --pairs p.bin", "none.glb"},
           {"p.bin --pairs p.bin", "invalid_scene"}}) {
    const auto wrong = run("visibility " + flags + " -o wrong.bin");
    EXPECT_EQ(wrong.code, 2) << flags << wrong.err;
    EXPECT_NE(wrong.err.find(words), std::string::npos) << flags << wrong.err;
  }
  EXPECT_FALSE(std::filesystem::exists(dir.path() / "wrong.bin"));
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
