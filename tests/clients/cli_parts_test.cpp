#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <csignal>

#include "server/cli/interrupt.h"
#include "server/cli/progress.h"
#include "server/cli/report.h"
#include "server/cli/settings_input.h"
#include "server/cli/side_files.h"
#include "tests/support/temp_files.h"

namespace kiln::cli {
namespace {

TEST(SideFiles, OnlyWhatTheSceneNamesInItsFolder) {
  const test::TempFolder dir;
  dir.write("outside.bin", "x");
  dir.write("s/room.bin", "x");
  dir.write("s/tex/wood grain.png", "x");
  dir.write("s/unnamed.png", "x");
  std::filesystem::create_symlink(dir.path() / "outside.bin", dir.path() / "s/link.bin");
  const auto scene = dir.write("s/room.gltf", R"({
    "buffers": [{"uri": "room.bin"}, {"uri": "data:,x"}, {"uri": "../outside.bin"},
                {"uri": "link.bin"}, {"uri": "%2e%2e/outside.bin"}, {}, {"uri": 3}, 7],
    "images": [{"uri": "tex/wood%20grain.png"}, {"uri": "missing.png"}, {"uri": "http://x/y"},
               {"uri": ")" + (dir.path() / "outside.bin").string() +
                                                  R"("}, {"uri": "%zz"},
               {"uri": "."}, {"uri": ""}, {"uri": "./room.bin"}]})");
  const auto found = find_side_files(scene);
  std::vector<std::string> names;
  for (const auto& [name, path] : found.files) names.push_back(name);
  EXPECT_EQ(names, (std::vector<std::string>{"room.bin", "tex/wood grain.png"}));
  EXPECT_TRUE(found.images);
}

TEST(SideFiles, ScenesThatCannotBeReadNameNothing) {
  const test::TempFolder dir;
  EXPECT_TRUE(find_side_files(dir.path() / "none.gltf").files.empty());
  for (const char* text : {"", "{", "[]", R"({"buffers": {}})", "glTF", "glTF\2\0\0\0"})
    EXPECT_TRUE(find_side_files(dir.write("a.gltf", text)).files.empty());
  // A .glb whose chunk claims more than the file holds.
  EXPECT_TRUE(find_side_files(dir.write("a.glb", std::string("glTF\2\0\0\0\xff\xff\xff\xff\xff\xff"
                                                             "\xff\xffJSON{}",
                                                             22)))
                  .files.empty());
}

TEST(SideFiles, BinaryScenesMayNameFilesToo) {
  const test::TempFolder dir;
  dir.write("b.bin", "x");
  const std::string json = R"({"buffers": [{"uri": "b.bin"}]})";
  std::string glb("glTF\2\0\0\0", 8);
  const auto put = [&](std::uint32_t v) {
    for (int i = 0; i < 4; ++i) glb += static_cast<char>(v >> (8 * i) & 0xffu);
  };
  put(static_cast<std::uint32_t>(20 + json.size()));
  put(static_cast<std::uint32_t>(json.size()));
  EXPECT_EQ(find_side_files(dir.write("a.glb", glb + "JSON" + json)).files.count("b.bin"), 1u);
}

TEST(SideFiles, TheUsersFilesWin) {
  const test::TempFolder dir;
  dir.write("tex/a.png", "old");
  const auto mine = dir.write("mine/a.png", "new");
  const auto scene = dir.write("s.gltf", R"({"images": [{"uri": "tex/a.png"}]})");
  const auto files = all_side_files(scene, {mine.string()});
  ASSERT_TRUE(files);
  ASSERT_EQ(files->files.size(), 1u);
  EXPECT_EQ(files->files.at("a.png"), mine);
  EXPECT_EQ(all_side_files(scene, {"/nonexistent"}).error().code, "missing_file");
  EXPECT_FALSE(all_side_files(scene, {mine.string(), (dir.path() / "tex/a.png").string()}));
}

TEST(SideFiles, TellWhetherThereAreImages) {
  const test::TempFolder dir;
  const auto plain = dir.write("plain.gltf", R"({"asset": {"version": "2.0"}})");
  const auto pictures = dir.write("pictures.gltf", R"({"images": [{"bufferView": 0}]})");
  EXPECT_FALSE(all_side_files(plain, {})->images);
  EXPECT_TRUE(all_side_files(plain, {}, "noon.exr")->images);
  EXPECT_TRUE(all_side_files(pictures, {})->images);
  EXPECT_TRUE(all_side_files(dir.write("broken.gltf", "{"), {})->images) << "nobody knows";
}

TEST(SettingsInput, FlagsOverTheFile) {
  const test::TempFolder dir;
  SettingsInput input;
  EXPECT_EQ(*input.document(), "");
  input.file = dir.write("s.json", R"({"solver": {"samples": 5, "seed": 2}})").string();
  input.sets = {"solver.samples=6", "output.formats=exr"};
  const auto settings = input.settings();
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->solver.samples, 6u);
  EXPECT_EQ(settings->solver.seed, 2u);
  EXPECT_EQ(settings->output.formats, std::vector<std::string>{"exr"});
  input.sets.push_back("solver.samples=0");
  EXPECT_EQ(input.document().error().details.at(0).pointer, "/solver/samples");
  input.file = (dir.path() / "none").string();
  EXPECT_EQ(input.document().error().code, "missing_file");
  input.file = dir.write("bad.json", "{,}").string();
  EXPECT_EQ(input.document().error().code, "invalid_json");
}

TEST(Report, ExitCodes) {
  const auto code = [](const char* c) { return exit_code_of({c, "", {}}); };
  for (const char* c : {"invalid_settings", "invalid_json", "invalid_scene", "no_light",
                        "missing_file", "not_found", "payload_too_large", "usage", "invalid_config",
                        "unknown_generator", "invalid_image", "atlas_full"})
    EXPECT_EQ(code(c), kUsage) << c;
  for (const char* c : {"internal", "canceled", "queue_full", "result_not_ready", "io_error",
                        "server_unreachable", "job_not_terminal", "out_of_memory", "storage_full"})
    EXPECT_EQ(code(c), kFailed) << c;
}

TEST(Report, SaysWhatWhereAndWhatToDo) {
  const std::string text = error_text(
      {"invalid_settings", "two", {{"settings", "/a", "x"}, {"settings", "/b", "y\x1b[2J"}}});
  EXPECT_NE(text.find("two  [invalid_settings]"), std::string::npos);
  EXPECT_NE(text.find("at settings /a: x"), std::string::npos);
  EXPECT_NE(text.find("hint: `lightkiln settings`"), std::string::npos);
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
}

TEST(Interrupt, ASignalRequestsAStopAndNothingElse) {
  for (const int signal : {SIGINT, SIGTERM}) {
    const Interrupt interrupt;
    const std::stop_token token = interrupt.token();
    EXPECT_FALSE(token.stop_requested());
    ::kill(::getpid(), signal);
    for (int i = 0; i < 1000 && !token.stop_requested(); ++i) ::usleep(10'000);
    EXPECT_TRUE(token.stop_requested());
  }
}

TEST(Interrupt, EndsAtOnceAndWithoutAStop) {
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 50; ++i) {
    std::stop_token token;
    {
      const Interrupt interrupt;
      token = interrupt.token();
    }
    EXPECT_FALSE(token.stop_requested());
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(2));
}

TEST(Progress, LinesOncePerStep) {
  const test::TempFolder dir;
  std::FILE* out = std::fopen((dir.path() / "log").c_str(), "w");
  ASSERT_NE(out, nullptr);
  {
    ProgressView view(ProgressView::Style::kLines, out);
    for (int i = 0; i <= 100; ++i) view.update({"solve", 0, 3, 0, 0, 1, i / 100.0});
    view.note("careful");
  }
  std::fclose(out);
  const std::string text = test::read_bytes(dir.path() / "log");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 12);
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
  EXPECT_NE(text.find("100 %  solve, pass 1 of at most 3"), std::string::npos);
  EXPECT_NE(text.find("careful\n"), std::string::npos);
}

}  // namespace
}  // namespace kiln::cli
